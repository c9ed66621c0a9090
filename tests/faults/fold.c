/* A file system that knows no upper and lower case, below one folder; loaded before libc
   (LD_PRELOAD). SCENETRACE_FOLD names the folder. */
#define _GNU_SOURCE
#include <ctype.h>
#include <dirent.h>
#include <dlfcn.h>
#include <fcntl.h>
#include <limits.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

/* The path that is meant, in `room` where letters of it change. */
static const char *folded(const char *path, char *room) {
  const char *folder = getenv("SCENETRACE_FOLD");
  char full[2 * PATH_MAX] = "";
  if (!path || !folder) return path;
  if (path[0] != '/') {
    if (!getcwd(full, PATH_MAX)) return path;
    strcat(full, "/");
  }
  strncat(full, path, PATH_MAX);
  size_t length = strlen(folder);
  if (strncmp(full, folder, length) || strlen(full) >= PATH_MAX) return path;
  strcpy(room, full);
  for (char *c = room + length; *c; c++) *c = tolower((unsigned char)*c);
  return room;
}

#define REAL(type, name, ...) \
  static type (*real)(__VA_ARGS__); \
  if (!real) real = dlsym(RTLD_NEXT, #name)

#define ONE(type, name) \
  type name(const char *path) { \
    REAL(type, name, const char *); \
    char room[PATH_MAX]; \
    return real(folded(path, room)); \
  }
#define AND(type, name, kind) \
  type name(const char *path, kind more) { \
    REAL(type, name, const char *, kind); \
    char room[PATH_MAX]; \
    return real(folded(path, room), more); \
  }
#define TWO(name) \
  int name(const char *from, const char *to) { \
    REAL(int, name, const char *, const char *); \
    char room[PATH_MAX], other[PATH_MAX]; \
    return real(folded(from, room), folded(to, other)); \
  }
#define OPEN(name) \
  int name(const char *path, int flags, ...) { \
    REAL(int, name, const char *, int, ...); \
    char room[PATH_MAX]; \
    va_list rest; \
    va_start(rest, flags); \
    mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0; \
    va_end(rest); \
    return real(folded(path, room), flags, mode); \
  }

ONE(int, unlink)
ONE(int, rmdir)
ONE(DIR *, opendir)
AND(int, mkdir, mode_t)
AND(int, access, int)
AND(int, stat, struct stat *)
AND(int, lstat, struct stat *)
AND(int, stat64, struct stat64 *)
AND(int, lstat64, struct stat64 *)
TWO(rename)
TWO(link)
OPEN(open)
OPEN(open64)

int linkat(int from_at, const char *from, int to_at, const char *to, int flags) {
  REAL(int, linkat, int, const char *, int, const char *, int);
  char room[PATH_MAX], other[PATH_MAX];
  return real(from_at, folded(from, room), to_at, folded(to, other), flags);
}
