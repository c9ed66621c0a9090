# %% [markdown]
# # A first look at a log
# `scenetrace demo` leaves an annotated log; any other will do as well. Each cell shows what its last line gives.

# %%
import scenetrace

log = scenetrace.open("annotated.mcap")
log

# %% [markdown]
# A frame, by number or by time.

# %%
log[40]

# %%
log.at(5.0)

# %% [markdown]
# Questions, and SQL.

# %%
log.ask("loitered", "scene", least="2s")

# %%
log.sql("SELECT kind, count(*) AS n FROM events GROUP BY kind ORDER BY n DESC, kind")
