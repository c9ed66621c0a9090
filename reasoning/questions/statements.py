"""The SQL of the ready questions. ``$only`` narrows to one recording; other ``$names`` are values.

Times are compared as they are shown, to the millisecond: a row at a limit that it shows itself is
in the answer.
"""

from reasoning.encounters.nearness import NEAR_ODDS, NEAR_POWER

SHOWN = """seen_share, existence, identity,
  least(seen_share, existence, identity) AS certainty, joins"""
"""How sure a row is; as many as its least sure part (see `schema.BELIEF`)."""

OF_ALL = """round(sum(seen_share * (end_frame - start_frame + 1)) / sum(end_frame - start_frame + 1), 4) AS seen_share,
    min(existence) AS existence, min(identity) AS identity,
    list_sort(list_distinct(flatten(list(joins)))) AS joins"""
"""How sure several intervals together are."""

BELIEF = "seen_share, existence, identity, joins"

NEAR = f"coalesce({NEAR_ODDS} / ({NEAR_ODDS} + nearest ** {NEAR_POWER}), 0.4)"
"""How sure it is that two came near one another at all, see `nearness.sure_near`: their shells may
touch in the picture alone, or at the edge. Of two who were never seen apart nobody knows.
"""

MET = f"""
-- intervals of A with one partner that follow one another within a second are one meeting
WITH mine AS (
  SELECT recording, b AS other, state, start_frame, end_frame, start_t, end_t, {BELIEF}, nearest
  FROM sure_relations WHERE a = $a$b$only
  UNION ALL
  SELECT recording, a, state, start_frame, end_frame, start_t, end_t, {BELIEF}, nearest
  FROM sure_relations WHERE b = $a$a_too$only),
marked AS (
  SELECT *, start_frame > 1 + coalesce(max(end_frame) OVER (
    PARTITION BY recording, other ORDER BY start_frame, end_frame
    ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING), -2) AND round(start_t - coalesce(max(end_t) OVER (
    PARTITION BY recording, other ORDER BY start_frame, end_frame
    ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING), -1e9), 3) > 1.0 AS fresh FROM mine),
numbered AS (
  SELECT *, sum(fresh::INTEGER) OVER (PARTITION BY recording, other ORDER BY start_frame, end_frame) AS meeting
  FROM marked),
whole AS (
  SELECT recording, other, min(start_frame) AS first, max(end_frame) AS last, min(start_t) AS start_t,
    max(end_t) AS end_t, round(max(end_t) - min(start_t), 3) AS seconds,
    round(coalesce(sum(end_t - start_t) FILTER (state = 'JOINT'), 0), 3) AS joint_s, min(nearest) AS nearest, {OF_ALL}
  FROM numbered GROUP BY recording, other, meeting)
SELECT recording, $a AS track, other, first AS start_frame, last AS end_frame, start_t, end_t, seconds, joint_s,
  nearest, seen_share, existence, identity,
  least(seen_share, existence, identity, round({NEAR}, 4)) AS certainty, joins,
  concat('relation:', least($a, other), '-', greatest($a, other), '@', first) AS explain
FROM whole ORDER BY recording, first, other
"""

TOGETHER = """
-- company: who else was together with one of the two for a second of that time: groups of three and more
SELECT e.recording, e.a, e.b, e.kind, e.start_frame, e.end_frame, e.start_t, e.end_t,
  round(e.end_t - e.start_t, 3) AS seconds, e.confidence, round(v.distance, 2) AS body_sizes_apart,
  round(v.relative_speed, 2) AS relative_speed,
  coalesce((SELECT list_sort(list_distinct(list(if(o.a IN (e.a, e.b), o.b, o.a)))) FROM sure_encounters o
    WHERE o.recording = e.recording AND (o.a IN (e.a, e.b)) <> (o.b IN (e.a, e.b))
      AND least(o.seen_share, o.existence, o.identity, o.confidence) >= $sure
      AND round(least(o.end_t, e.end_t) - greatest(o.start_t, e.start_t), 3) >= 1.0), []) AS company,
  e.seen_share, e.existence, e.identity,
  least(e.seen_share, e.existence, e.identity, e.confidence) AS certainty, e.joins,
  format('encounter:{}-{}@{}', e.a, e.b, e.start_frame) AS explain
FROM (FROM sure_encounters WHERE $who$only) e LEFT JOIN encounter_evidence v USING (recording, a, b, start_frame)
ORDER BY e.recording, e.start_frame, e.a, e.b
"""

BESIDE = 2.0
"""Who left within so many of their heights of one another left by the same way."""
BESIDE_ONLY = 0.4
"""Who left side by side, and was never otherwise together, left with somebody with at most so much:
on a street that was looked at from above, 1 of 98 such pairs knew one another.
"""

LEFT_WITH = f"""
-- with: in contact until at most $gap s before the first of them left; of several contacts the surest one;
-- and gone the same way, within {BESIDE:g} of their heights of one another: who pass go opposite ways.
-- leaving is the last exit; without one, the last sight of a track that was gone before the recording ended: then
-- nobody saw it leave, and it is as good as unsure
WITH departures AS (
  SELECT p.recording, p.track, p.end_frame AS frame, coalesce(x.t, p.end_t) AS t, x.event, p.existence, p.identity,
    p.joins, if(x.event IS NULL, 0.4, 1.0) AS seen_leaving, w.last_x, w.last_y, w.height
  FROM (SELECT recording, track, max(end_frame) AS end_frame, max(end_t) AS end_t,
          max(existence) AS existence, min(identity) AS identity,
          list_sort(list_distinct(flatten(list(joins)))) AS joins FROM presence
        WHERE true$only GROUP BY recording, track) p
  LEFT JOIN (SELECT recording, unnest(subjects) AS track, max(t) AS t, arg_max(event, t) AS event FROM sure_events
             WHERE kind = 'exited'$only GROUP BY recording, track) x USING (recording, track)
  JOIN recordings r ON r.recording = p.recording
  LEFT JOIN sure_targets w ON w.recording = p.recording AND w.track = p.track
  WHERE x.event IS NOT NULL OR p.end_t < r.seconds),
leaver AS (SELECT * FROM departures WHERE track = $a),
both_left AS (
  SELECT d.recording, d.track AS other, d.t, d.frame, d.event, l.t AS first_t, least(l.t, d.t) AS until_t,
    least(l.existence, d.existence) AS existence, least(l.identity, d.identity) AS identity,
    least(l.seen_leaving, d.seen_leaving) AS seen_leaving,
    list_sort(list_distinct(list_concat(l.joins, d.joins))) AS joins,
    round(sqrt((l.last_x - d.last_x) ** 2 + (l.last_y - d.last_y) ** 2) / greatest(l.height, d.height), 2)
      AS heights_apart
  FROM leaver l JOIN departures d ON d.recording = l.recording AND d.track <> l.track
    AND round(abs(d.t - l.t), 3) <= $within),
contact AS (
  SELECT recording, b AS other, start_t, end_t, 'relation' AS what, start_frame, seen_share,
    {BESIDE_ONLY} * {NEAR} AS near FROM sure_relations WHERE a = $a$only
  UNION ALL SELECT recording, a, start_t, end_t, 'relation', start_frame, seen_share,
    {BESIDE_ONLY} * {NEAR} FROM sure_relations WHERE b = $a$only
  UNION ALL SELECT recording, b, start_t, end_t, 'encounter', start_frame, seen_share, confidence
    FROM sure_encounters WHERE a = $a$only
  UNION ALL SELECT recording, a, start_t, end_t, 'encounter', start_frame, seen_share, confidence
    FROM sure_encounters WHERE b = $a$only),
last_contact AS (
  SELECT recording, other, max(c.end_t) AS end_t,
    max({{'sure': least(c.seen_share, c.near), 't': c.end_t, 'what': c.what, 'frame': c.start_frame,
      'seen': c.seen_share}}) AS which
  FROM both_left g JOIN contact c USING (recording, other)
  WHERE c.start_t <= g.until_t AND round(g.until_t - c.end_t, 3) <= $gap GROUP BY recording, other)
SELECT g.recording, $a AS track, g.other, g.first_t AS track_left_t, g.t AS other_left_t,
  round(g.t - g.first_t, 3) AS seconds_after, c.end_t AS last_contact_t, g.heights_apart,
  c.which.seen AS seen_share, g.existence, g.identity,
  least(round(c.which.sure, 4), g.existence, g.identity, g.seen_leaving) AS certainty, g.joins,
  concat_ws(' ', format('{{}}:{{}}-{{}}@{{}}', c.which.what, least($a, g.other), greatest($a, g.other),
    c.which.frame), if(g.event IS NULL,
    format('track:{{}}@{{}}', g.other, g.frame), format('event:{{}}', g.event))) AS explain
FROM both_left g JOIN last_contact c USING (recording, other)
WHERE g.heights_apart IS NULL OR g.heights_apart <= {BESIDE:g}
ORDER BY g.recording, abs(g.t - g.first_t), g.other
"""

_STAY = f"SELECT recording, track, start_frame, end_frame, start_t, end_t, {BELIEF}"

ZONE_STAYS = f"{_STAY} FROM zones WHERE zone = $zone"

SCENE_STAYS = f"{_STAY} FROM presence WHERE true"

WHO_WAS_IN = f"""
WITH stays AS ($stays$only)
SELECT s.recording, s.track, s.start_frame AS since_frame, s.end_frame AS until_frame,
  s.start_t AS since_t, s.end_t AS until_t, {SHOWN},
  concat('$what:', s.track, '@', s.start_frame, '$which') AS explain
FROM stays s WHERE $at BETWEEN s.start_t - 0.0005 AND s.end_t + 0.0005 ORDER BY s.recording, s.track
"""

STAYS_TOGETHER = f"""
-- stays with a gap of up to $gap s between them are one
marked AS (
  SELECT *, round(start_t - coalesce(max(end_t) OVER (PARTITION BY recording, track ORDER BY start_frame
    ROWS BETWEEN UNBOUNDED PRECEDING AND 1 PRECEDING), -1e9), 3) > $gap AS fresh FROM stays),
numbered AS (
  SELECT *, sum(fresh::INTEGER) OVER (PARTITION BY recording, track ORDER BY start_frame) AS stay FROM marked),
stay AS (
  SELECT recording, track, min(start_frame) AS first, max(end_frame) AS last, min(start_t) AS start_t,
    max(end_t) AS end_t, {OF_ALL} FROM numbered GROUP BY recording, track, stay"""
"""Ends within the last table, `stay`, which a question narrows further and closes."""

LOITERED = f"""
WITH stays AS ($stays$only),
{STAYS_TOGETHER}
  HAVING round(max(end_t) - min(start_t), 3) >= $least)
SELECT recording, track, first AS start_frame, last AS end_frame, start_t, end_t, round(end_t - start_t, 3) AS seconds,
  {SHOWN},
  concat('$what:', track, '@', first, '$which') AS explain
FROM stay ORDER BY recording, first, track
"""

BEHIND_NOTHING = 0.4
"""A part that is hidden by nobody who is followed, and by no edge of the picture, may be hidden by a
thing, or only not told from what is behind it: of 20 such rows that were looked at none was
hidden behind anything.
"""

HIDDEN = f"""
-- behind: whose box covers half of the part while his feet are nearer to the camera, for half of the row's frames
WITH told AS (FROM hidden WHERE $whose$only),
own AS (
  SELECT h.recording, h.track, h.part, h.start_frame, h.end_frame, k.frame, k.seen, k.y + k.h AS foot,
    r.width, r.height,
    k.x + if(part LIKE 'right%', k.w / 2, 0) AS x0, k.x + if(part LIKE 'left%', k.w / 2, k.w) AS x1,
    k.y + k.h * CASE WHEN part = 'head' THEN 0 WHEN part LIKE '%torso' THEN 1 ELSE 3.5 END / 7 AS y0,
    k.y + k.h * CASE WHEN part = 'head' THEN 1 WHEN part LIKE '%torso' THEN 3.5 ELSE 7 END / 7 AS y1
  FROM told h JOIN (FROM sure_tracks WHERE true$only) k ON k.recording = h.recording AND k.track = h.track
    AND k.frame BETWEEN h.start_frame AND h.end_frame
  JOIN recordings r ON r.recording = h.recording),
covered AS (
  SELECT o.recording, o.track, o.part, o.start_frame, o.end_frame, o.frame, k.track AS other
  FROM own o JOIN (FROM sure_tracks WHERE present AND seen$only) k ON k.recording = o.recording AND k.frame = o.frame
    AND k.track <> o.track AND (k.y + k.h > o.foot OR NOT o.seen)
    AND greatest(least(k.x + k.w, o.x1) - greatest(k.x, o.x0), 0)
      * greatest(least(k.y + k.h, o.y1) - greatest(k.y, o.y0), 0) >= 0.5 * (o.x1 - o.x0) * (o.y1 - o.y0)
  UNION ALL SELECT recording, track, part, start_frame, end_frame, frame, NULL FROM own
  WHERE width > 0 AND greatest(least(width, x1) - greatest(0, x0), 0) * greatest(least(height, y1) - greatest(0, y0), 0)
    < 0.5 * (x1 - x0) * (y1 - y0)),
why AS (
  SELECT recording, track, part, start_frame,
    list_sort(coalesce(list(DISTINCT other) FILTER (other IS NOT NULL), [])) AS behind
  FROM covered GROUP BY recording, track, part, start_frame, end_frame
  HAVING count(DISTINCT frame) >= (end_frame - start_frame + 1) / 2)
SELECT h.recording, h.track, h.part, h.start_frame, h.end_frame, h.start_t, h.end_t,
  round(h.end_t - h.start_t, 3) AS seconds, coalesce(w.behind, []) AS behind, h.seen_share, h.existence, h.identity,
  least(h.seen_share, h.existence, h.identity, if(w.behind IS NULL, {BEHIND_NOTHING}, 1.0)) AS certainty, h.joins,
  format('track:{{}}@{{}}', h.track, h.start_frame) AS explain
FROM told h LEFT JOIN why w USING (recording, track, part, start_frame)
ORDER BY h.recording, h.start_frame, h.track, h.part
"""

CAME = 0.5
"""Who comes in goes so many of his sizes in his first two seconds; who does not was standing there."""

ENTERED_NEVER_LEFT = f"""
-- who was there in the first frames did not come in; of who left and came in again the last time counts
-- who was not there at first and is now came in, seen or not (out of a group, through a door; or was hidden at first,
-- so that is less sure): from the first sight; who comes up beside somebody who was there from the start was likelier
-- behind him since then; who does not move at first was standing there, found late, and so was who is
-- not there for long enough to tell, and was not seen to come; who lies wholly inside a frame
-- after his first sight was not seen to come over an edge
-- who is lost before the end without having been seen to leave may be gone all the same: unsure
WITH told AS (
  SELECT recording, unnest(subjects) AS track, event, kind, frame, t FROM sure_events
  WHERE kind IN ('entering', 'entered', 'exited')$only),
gone AS (
  SELECT recording, track, max((frame, event)) AS at FROM told WHERE kind = 'exited' GROUP BY recording, track),
entered AS (
  SELECT t.recording, t.track, min(t.frame) AS frame, min(t.t) AS t, arg_min(t.event, (t.frame, t.event)) AS event,
    count(*) FILTER (t.kind = 'entering') > 0
      AND min(t.frame) FILTER (t.kind = 'entered') <= min(t.frame) + 1 AS at_once
  FROM told t LEFT JOIN gone g USING (recording, track)
  WHERE t.kind <> 'exited' AND (g.at IS NULL OR (t.frame, t.event) > g.at) GROUP BY t.recording, t.track),
stays AS (
  SELECT p.recording, p.track, g.at IS NOT NULL AS left_before, min(p.start_frame) AS first, min(p.start_t) AS first_t,
    max(p.end_frame) AS last, max(p.end_t) AS last_t, {OF_ALL}
  FROM (FROM presence WHERE true$only) p LEFT JOIN gone g USING (recording, track)
  WHERE g.at IS NULL OR p.end_frame > g.at[1] GROUP BY ALL),
first_ones AS (
  SELECT p.recording, p.track FROM presence p JOIN recordings r USING (recording)
  WHERE p.start_frame = r.first_frame),
behind AS (
  SELECT DISTINCT s.recording, s.track FROM stays s
  JOIN (SELECT recording, a AS track, b AS other, start_frame FROM sure_relations WHERE true$only
        UNION ALL SELECT recording, b, a, start_frame FROM sure_relations WHERE true$only) x
    ON x.recording = s.recording AND x.track = s.track AND x.start_frame = s.first
  JOIN first_ones f ON f.recording = x.recording AND f.track = x.other),
stayed AS (
  SELECT s.recording, s.track, coalesce(e.frame, s.first) AS entered_frame, coalesce(e.t, s.first_t) AS entered_t,
    s.last, s.last_t, s.last_t >= r.seconds AS there_at_the_end, e.event, s.seen_share, s.existence, s.identity,
    s.joins, h.track IS NOT NULL AS was_behind, coalesce(e.at_once, false) AS at_once,
    coalesce(w.first_way < {CAME:g}, e.event IS NULL OR e.at_once) AND NOT s.left_before AS stood
  FROM stays s LEFT JOIN entered e USING (recording, track) LEFT JOIN behind h USING (recording, track)
    LEFT JOIN sure_targets w ON w.recording = s.recording AND w.track = s.track
    JOIN recordings r USING (recording)
  WHERE (e.event IS NOT NULL AND (s.first > r.first_frame OR s.left_before))
    OR (e.event IS NULL AND s.first_t > $settled + coalesce((SELECT min(f.t) FROM frames f
      WHERE f.recording = s.recording AND f.frame = r.first_frame), 0)))
SELECT recording, track, entered_frame, entered_t, last AS last_seen_frame, last_t AS last_seen_t, there_at_the_end,
  seen_share, existence, identity,
  least(seen_share, existence, identity, if(there_at_the_end, 1.0, 0.4),
    CASE WHEN event IS NOT NULL AND NOT at_once THEN 1.0 WHEN was_behind AND event IS NULL THEN 0.4 ELSE 0.6 END,
    if(stood, 0.4, 1.0)) AS certainty,
  joins,
  concat_ws(' ', if(event IS NULL, format('track:{{}}@{{}}', track, entered_frame), format('event:{{}}', event)),
    format('track:{{}}@{{}}', track, last)) AS explain
FROM stayed ORDER BY recording, entered_frame, track
"""

JOINS, LEAVES = 0.2, 0.05
"""Who joins others closes in on them by so many body sizes a second, who leaves them draws away by so
many: who drives along in the next lane, or walks with somebody all the time, does neither.
"""

GROUPING_AND_SPLITTING = f"""
-- who is grouped with somebody again within a second did not leave him: two who walk side by side come apart in the
-- picture for moments; nor does anybody join who does not close in, or leave who does not draw away
WITH parted AS (
  SELECT s.*, EXISTS (FROM bits x WHERE x.recording = s.recording AND x.track = s.track AND x.bit = 'grouped'
    AND list_has_any(x.partners, s.partners) AND x.start_frame > s.start_frame AND x.start_t <= s.end_t + 1.0) AS again
  FROM bits s WHERE bit = 'splitting'$only)
SELECT g.recording, g.track, greatest(g.start_frame, s.start_frame) AS start_frame,
  least(g.end_frame, s.end_frame) AS end_frame, greatest(g.start_t, s.start_t) AS start_t,
  least(g.end_t, s.end_t) AS end_t, g.partners AS grouping_with, s.partners AS splitting_from,
  least(g.seen_share, s.seen_share) AS seen_share, least(g.existence, s.existence) AS existence,
  least(g.identity, s.identity) AS identity,
  least(g.seen_share, s.seen_share, g.existence, s.existence, g.identity, s.identity,
    if(s.again OR NOT coalesce(g.drift <= -{JOINS} AND s.drift >= {LEAVES}, false), 0.4, 1.0), g.near) AS certainty,
  list_sort(list_distinct(list_concat(g.joins, s.joins))) AS joins,
  format('track:{{}}@{{}}', g.track, greatest(g.start_frame, s.start_frame)) AS explain
FROM (SELECT *, round({NEAR}, 4) AS near FROM bits WHERE bit = 'grouping'$only) g JOIN parted s
  ON g.recording = s.recording AND g.track = s.track
  AND g.start_frame <= s.end_frame AND s.start_frame <= g.end_frame
ORDER BY g.recording, start_frame, g.track
"""

GROUP_HISTORY = """
WITH RECURSIVE links AS MATERIALIZED (
  SELECT recording, unnest(formed_from) AS parent, group_id AS child FROM sure_groups WHERE len(formed_from) > 0$only),
older(recording, group_id, generation) AS (
  SELECT recording, $label, 0 FROM sure_groups WHERE group_id = $label$only
  UNION SELECT l.recording, l.parent, o.generation - 1 FROM older o
    JOIN links l ON l.recording = o.recording AND l.child = o.group_id WHERE o.generation > -1000),
younger(recording, group_id, generation) AS (
  SELECT recording, $label, 0 FROM sure_groups WHERE group_id = $label$only
  UNION SELECT l.recording, l.child, y.generation + 1 FROM younger y
    JOIN links l ON l.recording = y.recording AND l.parent = y.group_id WHERE y.generation < 1000),
family AS (
  SELECT recording, group_id, max(generation) AS generation FROM older GROUP BY ALL
  UNION SELECT recording, group_id, min(generation) FROM younger GROUP BY ALL)
SELECT f.recording, CASE WHEN f.generation < 0 THEN 'ancestor' WHEN f.generation > 0 THEN 'descendant'
  ELSE 'itself' END AS is, f.generation, f.group_id, g.members, g.start_frame, g.end_frame, g.start_t, g.end_t,
  g.formed_from, g.ended_by, g.seen_share, g.existence, g.identity,
  least(g.seen_share, g.existence, g.identity) AS certainty, g.joins, format('group:{}', f.group_id) AS explain
FROM family f JOIN (FROM sure_groups WHERE true$only) g USING (recording, group_id)
-- labels rise with time: a family's lie close together, and no others need be looked through
WHERE g.group_id BETWEEN (SELECT min(group_id) FROM family) AND (SELECT max(group_id) FROM family)
ORDER BY f.recording, f.generation, g.start_frame, f.group_id
"""

BEFORE = f"""
WITH event AS (
  SELECT recording, event, t, frame, unnest(subjects) AS subject FROM sure_events WHERE event = $event$only),
pairs AS (
  SELECT recording, a, b, state AS how, 'relation' AS what, start_frame, start_t, end_t, {NEAR} AS confidence,
    {BELIEF}
  FROM sure_relations
  WHERE end_t >= (SELECT min(t) - $within - 0.001 FROM event)$only
  UNION ALL
  SELECT recording, a, b, 'together: ' || kind, 'encounter', start_frame, start_t, end_t, confidence, {BELIEF}
  FROM sure_encounters
  WHERE end_t >= (SELECT min(t) - $within - 0.001 FROM event)$only),
near AS (
  SELECT e.*, if(p.a = e.subject, p.b, p.a) AS other, p.* EXCLUDE (recording, a, b)
  FROM event e JOIN pairs p ON p.recording = e.recording AND e.subject IN (p.a, p.b)
    AND p.start_t < e.t AND round(e.t - p.end_t, 3) <= $within)
SELECT recording, event, subject, other, how, greatest(start_t, t - $within) AS from_t, least(end_t, t) AS until_t,
  round(t - least(end_t, t), 3) AS seconds_before, seen_share, existence, identity,
  least(seen_share, existence, identity, round(confidence, 4)) AS certainty, joins,
  format('{{}}:{{}}-{{}}@{{}} event:{{}}', what, least(subject, other), greatest(subject, other), start_frame,
    event) AS explain
FROM near ORDER BY recording, seconds_before, from_t, subject, other, how
"""

# Contacts: ``id`` is ascending with the start, and says which row it was: its first frame, or its
# group's label.


def _contact(holds: str) -> str:
    """Belief in a contact; ``holds``: how sure it is that the two were in contact at all."""
    return f"""{{'seen_share': seen_share, 'existence': existence, 'identity': identity, 'joins': joins,
  'holds': {holds}}} AS belief"""


_SURE = " AND least(seen_share, existence, identity) >= $sure"

BY_RELATIONS = f"""
SELECT recording, a, b, start_t, end_t, start_frame::BIGINT * 4294967296 AS id, {_contact(NEAR)}
FROM sure_relations WHERE true{_SURE} AND {NEAR} >= $sure$only"""

BY_JOINT = BY_RELATIONS.replace("WHERE true", "WHERE state = 'JOINT'")

BY_ENCOUNTERS = f"""
SELECT recording, a, b, start_t, end_t, start_frame::BIGINT * 4294967296 AS id, {_contact("confidence")}
FROM sure_encounters WHERE confidence >= $sure{_SURE}$only"""

BY_GROUPS = f"""
SELECT g.recording, m.a, n.b, g.start_t, g.end_t, g.start_frame::BIGINT * 4294967296 + g.group_id AS id,
  {_contact("1.0")}
FROM (FROM sure_groups WHERE true{_SURE}$only) g, unnest(g.members) AS m(a), unnest(g.members) AS n(b)
WHERE m.a < n.b"""

CONTACTS = """
-- a contact passes on only what came before its end; per target the earliest arrival over at most so many contacts
-- giver, taker, who: a target of a recording as one number, the recording's number * 2^32 + the track's id
-- contacts that are less sure than --certainty pass nothing on; a chain is as sure as its least sure contact
WITH RECURSIVE numbered AS MATERIALIZED (
  SELECT recording, row_number() OVER (ORDER BY recording) * 4294967296 AS base, CAST($since AS DOUBLE) AS since
  FROM recordings r WHERE true$only),
pairs AS MATERIALIZED (
  SELECT base + a AS a, base + b AS b, start_t, end_t, id, belief FROM ($contacts) JOIN numbered USING (recording)),
-- whom A met has it from A then: to them no contact that begins later passes it on first
by_then AS MATERIALIZED (
  SELECT who, min(t) AS t FROM (
    SELECT base + $a AS who, CAST('-Infinity' AS DOUBLE) AS t FROM numbered
    UNION ALL SELECT b, greatest(start_t, since) FROM pairs JOIN numbered ON a = base + $a WHERE end_t >= since
    UNION ALL SELECT a, greatest(start_t, since) FROM pairs JOIN numbered ON b = base + $a WHERE end_t >= since)
  GROUP BY who),
contact AS MATERIALIZED (
  SELECT a AS giver, b AS taker, start_t, end_t, id, belief FROM pairs LEFT JOIN by_then ON who = b
  WHERE t IS NULL OR start_t <= t
  UNION ALL SELECT b, a, start_t, end_t, id, belief FROM pairs LEFT JOIN by_then ON who = a
  WHERE t IS NULL OR start_t <= t),
reached(who, t, contacts, via, ids, seen_share, existence, identity, holds, joins) USING KEY (who) AS (
  SELECT base + $a, since, 0, CAST([] AS INTEGER[]), CAST([] AS BIGINT[]),
    CAST(1 AS DOUBLE), CAST(1 AS DOUBLE), CAST(1 AS DOUBLE), CAST(1 AS DOUBLE), CAST([] AS INTEGER[]) FROM numbered
  UNION (
    SELECT taker, first.t, s.contacts + 1, list_append(s.via, CAST(first.giver % 4294967296 AS INTEGER)),
      list_append(s.ids, first.id), least(s.seen_share, first.belief.seen_share),
      least(s.existence, first.belief.existence), least(s.identity, first.belief.identity),
      least(s.holds, first.belief.holds), list_concat(s.joins, first.belief.joins)
    FROM (
      SELECT n.taker, min({'t': greatest(s.t, n.first_t), 'giver': n.giver, 'id': n.id, 'belief': n.belief}) AS first
      -- of each giver the contact that began first of those that had not ended: that one passes on first
      FROM (
        SELECT d.giver, d.taker, min(d.start_t) AS first_t, min(d.id) AS id, arg_min(d.belief, d.id) AS belief
        FROM reached s JOIN contact d ON d.giver = s.who AND d.end_t >= s.t
        LEFT JOIN recurring.reached k ON k.who = d.taker
        WHERE s.contacts < $depth AND (k.t IS NULL OR s.t < k.t AND d.start_t < k.t) GROUP BY d.giver, d.taker) n
      JOIN reached s ON s.who = n.giver GROUP BY n.taker)
    JOIN reached s ON s.who = first.giver))
SELECT recording, CAST(who - base AS INTEGER) AS track, contacts, t AS reached_t, via, seen_share, existence, identity,
  least(seen_share, existence, identity, round(holds, 4)) AS certainty, list_sort(list_distinct(joins)) AS joins,
  array_to_string(list_transform(range(1, contacts + 1), lambda i: $why), ' ') AS explain
FROM reached JOIN numbered ON base = who - who % 4294967296
WHERE contacts > 0 ORDER BY recording, t, contacts, track
"""

PAIR_WHY = (
    "format('$what:{}-{}@{}', least(via[i], coalesce(via[i + 1], track)), "
    "greatest(via[i], coalesce(via[i + 1], track)), ids[i] // 4294967296)"
)
GROUP_WHY = "format('group:{}', ids[i] % 4294967296)"

TIMELINE = f"""
WITH told AS (
  SELECT recording, start_t, end_t, start_frame, 'present' AS what, CAST([] AS INTEGER[]) AS others, '' AS text,
    1.0 AS confidence, {BELIEF}, format('track:{{}}@{{}}', track, start_frame) AS explain
    FROM presence WHERE track = $a$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, 'in ' || zone, [], '', 1.0, {BELIEF},
    format('zone:{{}}@{{}}:{{}}', track, start_frame, url_encode(zone)) FROM zones WHERE track = $a$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, state, [b], '', 1.0, {BELIEF},
    concat('relation:', a, '-', b, '@', start_frame) FROM sure_relations WHERE a = $a$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, state, [a], '', 1.0, {BELIEF},
    concat('relation:', a, '-', b, '@', start_frame) FROM sure_relations WHERE b = $a$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, 'group ' || group_id,
    list_filter(members, lambda x: x <> $a), coalesce(ended_by, ''), 1.0, {BELIEF}, format('group:{{}}', group_id)
    FROM sure_groups WHERE list_contains(members, $a)$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, 'together: ' || kind, [b],
    format('confidence {{}}', confidence), confidence, {BELIEF}, concat('encounter:', a, '-', b, '@', start_frame)
    FROM sure_encounters WHERE a = $a$only
  UNION ALL SELECT recording, start_t, end_t, start_frame, 'together: ' || kind, [a],
    format('confidence {{}}', confidence), confidence, {BELIEF}, concat('encounter:', a, '-', b, '@', start_frame)
    FROM sure_encounters WHERE b = $a$only
  UNION ALL SELECT recording, t, t, frame, 'event ' || kind, list_filter(subjects, lambda x: x <> $a), text,
    1.0, {BELIEF}, format('event:{{}}', event) FROM sure_events WHERE list_contains(subjects, $a)$only)
SELECT recording, start_t, end_t, what, others, text, seen_share, existence, identity,
  least(seen_share, existence, identity, confidence) AS certainty, joins, explain FROM told
ORDER BY recording, start_t, end_t DESC, what, others, explain
"""
