/* Lets the n-th call that touches a folder fail, or kills the process there; loaded before libc
   (LD_PRELOAD). */
#define _GNU_SOURCE
#include <dirent.h>
#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <limits.h>
#include <signal.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stdio.h>
#include <string.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <sys/types.h>
#include <sys/uio.h>
#include <unistd.h>

enum { CHANGES = 1, READS = 2 };

static atomic_long calls;
static int counted = CHANGES;
static long fail_at = -1, fail_times = 1;
static int fail_error;
static const char *struck;
static char folder[PATH_MAX];

/* Count from now on, and fail call `at` (from 1; 0: none) and those after it, `times` in all; an
   error below 0 is SIGKILL before the call. */
void fail_arm(const char *below, long at, long times, int error) {
  strncpy(folder, below, sizeof folder - 1);
  fail_at = at;
  fail_times = times;
  fail_error = error;
  struck = 0;
  atomic_store(&calls, 0);
}

/* Which calls count: those that change something (1), those that only read (2). */
void fail_kind(int kind) { counted = kind; }

long fail_count(void) { return atomic_load(&calls); }

/* The first call that failed; empty if none did. */
const char *fail_struck(void) { return struck ? struck : ""; }

static int below(const char *path) {
  return path && folder[0] && strncmp(path, folder, strlen(folder)) == 0;
}

static int open_below(int fd) {
  char name[64], path[PATH_MAX];
  if (!folder[0]) return 0;
  snprintf(name, sizeof name, "/proc/self/fd/%d", fd);
  ssize_t n = readlink(name, path, sizeof path - 1);
  if (n < 0) return 0;
  path[n] = 0;
  return below(path);
}

static int absolute_below(const char *path) {
  char full[2 * PATH_MAX];
  if (!path) return 0;
  if (path[0] == '/') return below(path);
  if (!getcwd(full, PATH_MAX)) return 0;
  strncat(full, "/", sizeof full - strlen(full) - 1);
  strncat(full, path, sizeof full - strlen(full) - 1);
  return below(full);
}

static int strikes_kind(int kind, const char *call) {
  if (kind != counted) return 0;
  long n = atomic_fetch_add(&calls, 1) + 1;
  if (fail_at > 0 && n >= fail_at && n < fail_at + fail_times) {
    if (!struck) struck = call;
    if (fail_error < 0) kill(getpid(), SIGKILL);
    errno = fail_error;
    return 1;
  }
  return 0;
}

static int strikes(const char *call) { return strikes_kind(CHANGES, call); }

static int strikes_read(const char *call) { return strikes_kind(READS, call); }

/* A look at a file is counted with either kind. */
static int strikes_look(const char *call) { return strikes_kind(counted, call); }

#define REAL(type, name, ...) \
  static type (*real)(__VA_ARGS__); \
  if (!real) real = dlsym(RTLD_NEXT, #name)

ssize_t write(int fd, const void *data, size_t size) {
  REAL(ssize_t, write, int, const void *, size_t);
  if (fd > 2 && open_below(fd) && strikes(__func__)) {
    /* A disk that fills takes what still fits. */
    if (fail_error == ENOSPC && size > 1 && fail_times > 1 && atomic_load(&calls) == fail_at)
      return real(fd, data, size / 2);
    return -1;
  }
  return real(fd, data, size);
}

ssize_t pwrite64(int fd, const void *data, size_t size, off64_t at) {
  REAL(ssize_t, pwrite64, int, const void *, size_t, off64_t);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd, data, size, at);
}

ssize_t writev(int fd, const struct iovec *parts, int count) {
  REAL(ssize_t, writev, int, const struct iovec *, int);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd, parts, count);
}

int fsync(int fd) {
  REAL(int, fsync, int);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd);
}

int fdatasync(int fd) {
  REAL(int, fdatasync, int);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd);
}

int ftruncate64(int fd, off64_t size) {
  REAL(int, ftruncate64, int, off64_t);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd, size);
}

int rename(const char *from, const char *to) {
  REAL(int, rename, const char *, const char *);
  if (absolute_below(to) && strikes(__func__)) return -1;
  return real(from, to);
}

int link(const char *from, const char *to) {
  REAL(int, link, const char *, const char *);
  if (absolute_below(to) && strikes(__func__)) return -1;
  return real(from, to);
}

int unlink(const char *path) {
  REAL(int, unlink, const char *);
  if (absolute_below(path) && strikes(__func__)) return -1;
  return real(path);
}

int linkat(int from_at, const char *from, int to_at, const char *to, int flags) {
  REAL(int, linkat, int, const char *, int, const char *, int);
  if (absolute_below(to) && strikes(__func__)) return -1;
  return real(from_at, from, to_at, to, flags);
}

int stat64(const char *path, struct stat64 *found) {
  REAL(int, stat64, const char *, struct stat64 *);
  if (absolute_below(path) && strikes_look(__func__)) return -1;
  return real(path, found);
}

int fstat64(int fd, struct stat64 *found) {
  REAL(int, fstat64, int, struct stat64 *);
  if (fd > 2 && open_below(fd) && strikes_look(__func__)) return -1;
  return real(fd, found);
}

int lstat64(const char *path, struct stat64 *found) {
  REAL(int, lstat64, const char *, struct stat64 *);
  if (absolute_below(path) && strikes_look(__func__)) return -1;
  return real(path, found);
}

ssize_t read(int fd, void *data, size_t size) {
  REAL(ssize_t, read, int, void *, size_t);
  if (fd > 2 && open_below(fd) && strikes_read(__func__)) return -1;
  return real(fd, data, size);
}

ssize_t pread64(int fd, void *data, size_t size, off64_t at) {
  REAL(ssize_t, pread64, int, void *, size_t, off64_t);
  if (open_below(fd) && strikes_read(__func__)) return -1;
  return real(fd, data, size, at);
}

off64_t lseek64(int fd, off64_t at, int from) {
  REAL(off64_t, lseek64, int, off64_t, int);
  if (fd > 2 && open_below(fd) && strikes_read(__func__)) return -1;
  return real(fd, at, from);
}

DIR *opendir(const char *path) {
  REAL(DIR *, opendir, const char *);
  if (absolute_below(path) && strikes_read(__func__)) return 0;
  return real(path);
}

int flock(int fd, int how) {
  REAL(int, flock, int, int);
  if (open_below(fd) && strikes(__func__)) return -1;
  return real(fd, how);
}

int rmdir(const char *path) {
  REAL(int, rmdir, const char *);
  if (absolute_below(path) && strikes(__func__)) return -1;
  return real(path);
}

/* Relative to an open folder, as trees of files are removed. */
int unlinkat(int at, const char *path, int flags) {
  REAL(int, unlinkat, int, const char *, int);
  if ((at == AT_FDCWD ? absolute_below(path) : open_below(at)) && strikes(__func__)) return -1;
  return real(at, path, flags);
}

int renameat(int from_at, const char *from, int to_at, const char *to) {
  REAL(int, renameat, int, const char *, int, const char *);
  if ((to_at == AT_FDCWD ? absolute_below(to) : open_below(to_at)) && strikes(__func__)) return -1;
  return real(from_at, from, to_at, to);
}

int mkdir(const char *path, mode_t mode) {
  REAL(int, mkdir, const char *, mode_t);
  if (absolute_below(path) && strikes(__func__)) return -1;
  return real(path, mode);
}

static int opened(int (*real)(const char *, int, ...), const char *path, int flags, mode_t mode) {
  int kind = flags & (O_CREAT | O_WRONLY | O_RDWR) ? CHANGES : READS;
  if (absolute_below(path) && strikes_kind(kind, "open")) return -1;
  return real(path, flags, mode);
}

int open64(const char *path, int flags, ...) {
  REAL(int, open64, const char *, int, ...);
  va_list rest;
  va_start(rest, flags);
  mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return opened(real, path, flags, mode);
}

int open(const char *path, int flags, ...) {
  REAL(int, open, const char *, int, ...);
  va_list rest;
  va_start(rest, flags);
  mode_t mode = flags & (O_CREAT | O_TMPFILE) ? va_arg(rest, mode_t) : 0;
  va_end(rest);
  return opened(real, path, flags, mode);
}

int close(int fd) {
  REAL(int, close, int);
  int counts = fd > 2 && open_below(fd) && (fcntl(fd, F_GETFL) & O_ACCMODE) != O_RDONLY;
  int bad = counts && strikes(__func__);
  int error = errno, done = real(fd);
  if (bad) {
    errno = error;
    return -1;
  }
  return done;
}
