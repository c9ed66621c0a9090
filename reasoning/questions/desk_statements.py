"""The SQL of the questions that an investigator asks: lines and zones, who followed whom, what
happened between two moments, who left or took a thing. As in `statements`, ``$only`` narrows to
one recording and times are compared as they are shown, to the millisecond.
"""

from reasoning.questions.statements import BELIEF, CAME, SHOWN, STAYS_TOGETHER

CROSSED = f"""
SELECT recording, track, frame, t, direction, x, y, {SHOWN},
  concat('line:', track, '@', frame, ':', url_encode(line)) AS explain
FROM crossings WHERE line = $line$which$only ORDER BY recording, frame, track
"""

DWELL = f"""
WITH stays AS ($stays$only),{STAYS_TOGETHER}),
sure AS (SELECT *, least(seen_share, existence, identity) AS certainty FROM stay)
SELECT recording, track, count(*) AS stays, round(sum(end_t - start_t), 3) AS seconds,
  round(max(end_t - start_t), 3) AS longest_s, min(start_t) AS start_t, max(end_t) AS end_t,
  round(sum(seen_share * (end_t - start_t + 0.001)) / sum(end_t - start_t + 0.001), 4) AS seen_share,
  min(existence) AS existence, min(identity) AS identity,
  least(round(sum(seen_share * (end_t - start_t + 0.001)) / sum(end_t - start_t + 0.001), 4), min(existence),
    min(identity)) AS certainty,
  list_sort(list_distinct(flatten(list(joins)))) AS joins,
  string_agg(concat('$what:', track, '@', first, '$which'), ' ' ORDER BY first) AS explain
FROM sure GROUP BY recording, track ORDER BY recording, seconds DESC, track
"""

COUNT = f"""
-- of a line: crossings by direction; of a zone: who came in and who went out; who is there in the first second did
-- not come in, who is there in the last frame did not go out
WITH stays AS ($stays$only),{STAYS_TOGETHER}),
ways AS (
  SELECT direction FROM lines WHERE line = $name
  UNION ALL SELECT unnest(['in', 'out']) WHERE NOT EXISTS (SELECT 1 FROM lines WHERE line = $name)),
told AS (
  SELECT recording, track, t, direction, least(seen_share, existence, identity) AS certainty,
    concat('line:', track, '@', frame, '$which') AS why
  FROM crossings WHERE line = $name$only
  UNION ALL SELECT s.recording, track, start_t, 'in', least(seen_share, existence, identity),
    concat('$what:', track, '@', first, '$which')
  FROM stay s JOIN recordings r USING (recording)
  WHERE s.start_t > $settled + coalesce((SELECT min(f.t) FROM frames f WHERE f.recording = s.recording
    AND f.frame = r.first_frame), 0)
  UNION ALL SELECT s.recording, track, end_t, 'out', least(seen_share, existence, identity),
    concat('$what:', track, '@', first, '$which')
  FROM stay s JOIN recordings r USING (recording) WHERE s.end_t < r.seconds),
spans AS (
  SELECT recording, direction, unnest(range(0, 1 + CAST(floor(seconds / $every) AS BIGINT))) AS n
  FROM recordings, ways WHERE true$only)
SELECT s.recording, s.direction, CAST(round(any_value(s.n) * $every, 3) AS DOUBLE) AS start_t,
  CAST(round((any_value(s.n) + 1) * $every, 3) AS DOUBLE) AS end_t,
  count(*) FILTER (certainty >= $sure) AS count, count(DISTINCT track) FILTER (certainty >= $sure) AS individuals,
  count(*) FILTER (certainty < $sure) AS unsure, min(certainty) FILTER (certainty >= $sure) AS least_certainty,
  string_agg(why, ' ' ORDER BY t, track) FILTER (certainty >= $sure) AS explain
FROM spans s LEFT JOIN told t ON t.recording = s.recording AND t.direction = s.direction
  AND CAST(floor(t.t / $every) AS BIGINT) = s.n
GROUP BY s.recording, s.direction, s.n ORDER BY s.recording, s.n, s.direction
"""

FOLLOWED = """
-- B is on A's trail at a moment if it stands where A stood between $shortest and $within s before, A has gone on
-- since, and it is much nearer to that place than to A: who walks beside A is not. Five moments a second. B follows if
-- it comes to A's places in A's order, at a quarter of A's pace or more: who comes
-- towards A walks the same way back. The farther off the trail, the less sure
WITH whose AS (SELECT DISTINCT recording FROM presence WHERE track = $a$only),
sample AS (
  SELECT recording, frame, t FROM (
    SELECT recording, frame, t, floor(t * 5) <> lag(floor(t * 5), 1, -1) OVER (PARTITION BY recording ORDER BY frame)
      AS chosen FROM frames SEMI JOIN whose USING (recording) WHERE true$only) WHERE chosen),
placed AS (
  SELECT k.recording, k.track, s.t, s.frame, x + w / 2 AS px, y + h AS py, sqrt(w * w + h * h) AS size, seen,
    confidence, identity
  FROM sample s JOIN (FROM sure_tracks WHERE present$only) k USING (recording, frame)),
mine AS (FROM placed WHERE track = $a),
trail AS (
  SELECT b.recording, b.track, b.frame, any_value(b.t) AS t, any_value(b.px) AS px, any_value(b.py) AS py,
    any_value(b.size) AS size, any_value(b.seen) AS seen,
    least(any_value(b.confidence), any_value(n.confidence)) AS existence,
    least(any_value(b.identity), any_value(n.identity)) AS identity,
    min_by(b.t - a.t, (a.px - b.px) ** 2 + (a.py - b.py) ** 2) AS behind_s,
    sqrt(min((a.px - b.px) ** 2 + (a.py - b.py) ** 2)) / any_value(b.size) AS off_sizes
  FROM placed b JOIN mine a ON a.recording = b.recording AND a.t BETWEEN b.t - $within AND b.t - $shortest
  LEFT JOIN mine n ON n.recording = b.recording AND n.frame = b.frame
  WHERE b.track <> $a$whom AND (a.px - b.px) ** 2 + (a.py - b.py) ** 2 <= (0.6 * b.size) ** 2
    AND (n.px IS NULL OR ((n.px - a.px) ** 2 + (n.py - a.py) ** 2 >= (0.75 * b.size) ** 2
      AND (a.px - b.px) ** 2 + (a.py - b.py) ** 2 <= 0.25 * ((n.px - b.px) ** 2 + (n.py - b.py) ** 2)))
  GROUP BY b.recording, b.track, b.frame),
marked AS (
  SELECT *, t - coalesce(lag(t) OVER (PARTITION BY recording, track ORDER BY t), -1e9) > 1.0 AS fresh FROM trail),
numbered AS (SELECT *, sum(fresh::INTEGER) OVER (PARTITION BY recording, track ORDER BY t) AS n FROM marked),
whole AS (
  SELECT recording, track, min(frame) AS start_frame, max(frame) AS end_frame, min(t) AS start_t, max(t) AS end_t,
    round(max(t) - min(t), 3) AS seconds, round(median(behind_s), 2) AS behind_s,
    round(median(off_sizes), 2) AS off_sizes,
    sqrt((arg_max(px, t) - arg_min(px, t)) ** 2 + (arg_max(py, t) - arg_min(py, t)) ** 2) / median(size) AS way,
    coalesce(regr_slope(t - behind_s, t), 0) AS pace,
    round(avg(seen::INTEGER), 4) AS seen_share, round(avg(existence), 4) AS existence, min(identity) AS identity
  FROM numbered GROUP BY recording, track, n)
SELECT recording, $a AS track, track AS follower, start_frame, end_frame, start_t, end_t, seconds, behind_s, off_sizes,
  round(way, 2) AS body_sizes, seen_share, existence, identity,
  least(seen_share, existence, identity, 1 - off_sizes) AS certainty,
  concat('track:', track, '@', start_frame, ' track:', track, '@', end_frame) AS explain
FROM whole WHERE seconds >= $least AND way >= 2 AND pace >= 0.25 ORDER BY recording, start_t, follower
"""

FIRST_LAST = f"""
-- nobody appears out of nothing: who is first seen within the picture was hidden until then, or there and not found;
-- surely so if he did not move at first, or came out of a group. Who is last seen there, and did not go out of the
-- region of interest, may be there still
WITH ends AS (
  SELECT recording, 'first seen' AS what, min_by(start_frame, start_frame) AS frame, min(start_t) AS t,
    min_by(existence, start_frame) AS existence, min_by(identity, start_frame) AS identity FROM presence
  WHERE track = $a$only GROUP BY recording
  UNION ALL SELECT recording, 'last seen', max(end_frame), max(end_t), max_by(existence, end_frame),
    max_by(identity, end_frame) FROM presence WHERE track = $a$only GROUP BY recording),
told AS (
  SELECT recording, kind, frame FROM sure_events WHERE list_contains(subjects, $a)
    AND kind IN ('entering', 'exited')$only),
shown AS (
  SELECT e.*, round(k.x + k.w / 2, 1) AS x, round(k.y + k.h, 1) AS y, k.seen, k.x AS left_x, k.x + k.w AS right_x,
    k.y AS top_y, k.y + k.h AS foot_y, r.width, r.height, r.seconds, r.first_frame,
    coalesce(w.first_way < {CAME:g}, true) AS stood,
    EXISTS (FROM told o WHERE o.recording = e.recording AND o.frame BETWEEN e.frame - 1 AND e.frame + 1
      AND o.kind = if(e.what = 'first seen', 'entering', 'exited')) AS told
  FROM ends e JOIN (FROM sure_tracks WHERE track = $a$only) k USING (recording, frame)
  JOIN recordings r USING (recording)
  LEFT JOIN sure_targets w ON w.recording = e.recording AND w.track = $a),
placed AS (
  SELECT *, CASE WHEN what = 'first seen' AND frame = first_frame THEN 'there from the start'
    WHEN what = 'last seen' AND t >= seconds THEN 'there at the end'
    WHEN width > 0 AND left_x < 0.05 * width THEN 'at the left edge'
    WHEN width > 0 AND right_x > 0.95 * width THEN 'at the right edge'
    WHEN height > 0 AND foot_y > 0.95 * height THEN 'at the lower edge'
    WHEN height > 0 AND top_y < 0.05 * height THEN 'at the upper edge'
    ELSE 'within the picture' END AS place FROM shown)
SELECT recording, $a AS track, what, frame, t, x, y, place,
  (SELECT string_agg(z.zone, ', ' ORDER BY z.zone) FROM zones z WHERE z.recording = s.recording AND z.track = $a
    AND s.frame BETWEEN z.start_frame AND z.end_frame) AS zones,
  seen, existence, identity,
  least(existence, identity, CASE WHEN place <> 'within the picture' OR width = 0 THEN 1.0
    WHEN told AND what = 'last seen' THEN 1.0 WHEN told AND NOT stood THEN 0.6 ELSE 0.4 END) AS certainty,
  concat('track:', $a, '@', frame) AS explain
FROM placed s ORDER BY recording, t, what
"""

BETWEEN = f"""
WITH whole AS (SELECT recording, $t1 AS from_t, $t2 AS until_t FROM recordings r WHERE true$only),
told AS (
  SELECT recording, t, frame, subjects AS targets, kind AS what, text, 1.0 AS confidence, {BELIEF},
    format('event:{{}}', event) AS explain FROM sure_events WHERE kind IN ($told)$only
  UNION ALL SELECT recording, start_t, start_frame, [a, b], 'together: ' || kind,
    format('{{}} and {{}} are together until {{:.1f}} s', a, b, end_t), confidence, {BELIEF},
    concat('encounter:', a, '-', b, '@', start_frame) FROM sure_encounters WHERE true$only
  UNION ALL SELECT recording, end_t, end_frame, [a, b], 'together no more: ' || kind,
    format('{{}} and {{}} were together from {{:.1f}} s', a, b, start_t), confidence, {BELIEF},
    concat('encounter:', a, '-', b, '@', start_frame) FROM sure_encounters WHERE true$only
  UNION ALL SELECT recording, start_t, start_frame, [track], 'in ' || zone,
    format('until {{:.1f}} s', end_t), 1.0, {BELIEF},
    concat('zone:', track, '@', start_frame, ':', url_encode(zone)) FROM zones WHERE true$only
  UNION ALL SELECT recording, t, frame, [track], 'crossed ' || line, direction, 1.0, {BELIEF},
    concat('line:', track, '@', frame, ':', url_encode(line)) FROM crossings WHERE true$only)
SELECT t.recording, t, frame, what, targets, text, seen_share, existence, identity,
  least(seen_share, existence, identity, confidence) AS certainty, joins, explain
FROM told t JOIN whole w USING (recording)
WHERE round(t - w.from_t, 3) >= 0 AND round(w.until_t - t, 3) >= 0
ORDER BY t.recording, t, what, targets, explain
"""

_THINGS = """
-- a thing stands still nearly all its time and is small: no more than half of what the others usually cover
sizes AS (
  SELECT recording, track, median(w * h) AS area FROM tracks WHERE present$only GROUP BY recording, track),
usual AS (SELECT recording, median(area) AS area FROM sizes GROUP BY recording),
rested AS (
  SELECT recording, track, sum(end_t - start_t) AS still_s, max(end_frame) AS end_frame, max(end_t) AS end_t
  FROM still WHERE true$only GROUP BY recording, track),
seen AS (
  SELECT recording, track, min(start_frame) AS first, min(start_t) AS first_t, max(end_frame) AS last,
    max(end_t) AS last_t, max(existence) AS existence, min(identity) AS identity,
    list_sort(list_distinct(flatten(list(joins)))) AS joins
  FROM presence WHERE true$only GROUP BY recording, track),
thing AS (
  -- what begins to move after it stood is taken then, whatever becomes of its track
  SELECT s.* EXCLUDE (last, last_t), r.seconds, if(x.end_t < s.last_t - 1, x.end_frame, s.last) AS last,
    if(x.end_t < s.last_t - 1, x.end_t, s.last_t) AS last_t
  FROM seen s JOIN sizes z USING (recording, track) JOIN usual u USING (recording) JOIN recordings r USING (recording)
  LEFT JOIN rested x USING (recording, track)
  WHERE $whose AND ($named OR (z.area <= 0.5 * u.area AND s.last_t - s.first_t >= 2
    AND coalesce(x.still_s, 0) >= 0.7 * (s.last_t - s.first_t)))),
-- who was within a body's size of it at that moment, give or take a second
near AS (
  SELECT t.*, k.track AS who, k.identity AS who_identity, o.x AS ox, o.y AS oy, o.w AS ow, o.h AS oh,
    sqrt(greatest(0, greatest(k.x, o.x) - least(k.x + k.w, o.x + o.w)) ** 2
      + greatest(0, greatest(k.y, o.y) - least(k.y + k.h, o.y + o.h)) ** 2) / sqrt(k.w * k.w + k.h * k.h) AS apart
  FROM thing t
  JOIN (FROM sure_tracks WHERE true$only) o ON o.recording = t.recording AND o.track = t.track AND o.frame = t.$end
  JOIN (FROM sure_tracks WHERE present$only) k ON k.recording = t.recording AND k.track <> t.track
    AND abs(k.t - t.${end}_t) <= 1.0),
closest AS (
  SELECT recording, track, who, any_value($end) AS frame, any_value(${end}_t) AS t, any_value(last_t) AS last_t,
    any_value(existence) AS existence, least(any_value(identity), min(who_identity)) AS identity,
    any_value(joins) AS joins, any_value(ox) AS ox, any_value(oy) AS oy, any_value(ow) AS ow, any_value(oh) AS oh,
    min(apart) AS apart
  FROM near GROUP BY recording, track, who HAVING min(apart) <= 1.0),
-- the nearest, and how much nearer than the next one
ranked AS (
  SELECT *, row_number() OVER one AS rank, count(*) OVER (PARTITION BY recording, track) AS candidates,
    lead(apart) OVER one AS next_apart
  FROM closest WINDOW one AS (PARTITION BY recording, track ORDER BY apart, who))"""

_WHO = """object, who, frame, t, round(apart, 2) AS body_sizes_apart, candidates"""

_SURE_WHO = """existence, identity,
  least(existence, identity, 1 - 0.5 * apart, if(candidates = 1, 1.0, 0.5 + 0.5 * least(1.0, next_apart - apart)))
    AS certainty, joins, concat('track:', object, '@', frame, ' track:', who, '@', frame) AS explain"""

LEFT_BEHIND = f"""
WITH{_THINGS},
gone AS (
  SELECT r.* RENAME (track AS object), coalesce(
    (SELECT min(k.t) FROM tracks k WHERE k.recording = r.recording AND k.track = r.who AND k.present AND k.t > r.t
      AND sqrt(greatest(0, greatest(k.x, ox) - least(k.x + k.w, ox + ow)) ** 2 +
        greatest(0, greatest(k.y, oy) - least(k.y + k.h, oy + oh)) ** 2) > sqrt(k.w * k.w + k.h * k.h)),
    (SELECT max(p.end_t) FROM presence p WHERE p.recording = r.recording AND p.track = r.who
      HAVING max(p.end_t) < r.last_t)) AS away_t
  FROM ranked r WHERE rank = 1)
SELECT recording, {_WHO}, away_t AS went_away_t, round(last_t - away_t, 3) AS alone_s,
  {_SURE_WHO}
FROM gone ORDER BY recording, t, object
"""

TOOK = f"""
WITH{_THINGS},
gone AS (SELECT * RENAME (track AS object) FROM ranked WHERE rank = 1)
SELECT recording, {_WHO},
  {_SURE_WHO}
FROM gone ORDER BY recording, t, object
"""

MOVED = """
-- positions once a second, so that a trembling box walks nowhere; speeds over a second
WITH placed AS (
  SELECT recording, track, CAST(floor(t) AS BIGINT) AS second, median(x_m) AS x_m, median(y_m) AS y_m,
    median(t) AS t, avg(error_m) / sqrt(least(count(*), 5)) AS error_m, any_value(off_share) AS off_share,
    avg(seen::INTEGER) AS seen
  FROM metres WHERE x_m IS NOT NULL AND $whose$only GROUP BY recording, track, second),
steps AS (
  SELECT *, sqrt((x_m - lag(x_m) OVER one) ** 2 + (y_m - lag(y_m) OVER one) ** 2) AS step,
    t - lag(t) OVER one AS seconds, error_m * sqrt(2) AS step_error
  FROM placed WINDOW one AS (PARTITION BY recording, track ORDER BY second))
SELECT s.recording, s.track, min(s.t) AS start_t, max(s.t) AS end_t, round(sum(step), 2) AS metres,
  round(sqrt(sum(step_error ** 2) FILTER (step IS NOT NULL)) + any_value(off_share) * sum(step), 2) AS metres_error,
  round(sqrt((arg_max(x_m, s.t) - arg_min(x_m, s.t)) ** 2 + (arg_max(y_m, s.t) - arg_min(y_m, s.t)) ** 2), 2)
    AS straight_m, round(sum(step) / sum(seconds), 2) AS mean_mps,
  round(quantile_cont(step / seconds, 0.9), 2) AS top_mps,
  round(median(step_error / seconds) + any_value(off_share) * sum(step) / sum(seconds), 2) AS mps_error,
  round(avg(s.seen), 4) AS seen_share, any_value(p.existence) AS existence, any_value(p.identity) AS identity,
  least(round(avg(s.seen), 4), any_value(p.existence), any_value(p.identity)) AS certainty,
  concat('track:', s.track, '@', any_value(p.first)) AS explain
FROM steps s JOIN (
  SELECT recording, track, min(start_frame) AS first, max(existence) AS existence, min(identity) AS identity
  FROM presence GROUP BY recording, track) p USING (recording, track)
GROUP BY s.recording, s.track HAVING count(step) > 0 ORDER BY s.recording, s.track
"""

APART = """
WITH pairs AS (
  SELECT a.recording, a.frame, a.t, sqrt((a.x_m - b.x_m) ** 2 + (a.y_m - b.y_m) ** 2) AS metres,
    sqrt(a.error_m ** 2 + b.error_m ** 2) AS error_m, a.off_share, a.seen AND b.seen AS seen
  FROM (FROM metres WHERE track = $a$only) a JOIN (FROM metres WHERE track = $b$only) b USING (recording, frame)
  WHERE a.x_m IS NOT NULL AND b.x_m IS NOT NULL)
SELECT recording, $a AS a, $b AS b, min(t) AS start_t, max(t) AS end_t, round(min(metres), 2) AS least_m,
  round(arg_min(error_m, metres) + any_value(off_share) * min(metres), 2) AS least_error,
  arg_min(t, metres) AS least_t, round(median(metres), 2) AS median_m,
  round(median(error_m) + any_value(off_share) * median(metres), 2) AS median_error,
  round(avg(seen::INTEGER), 4) AS seen_share, round(avg(seen::INTEGER), 4) AS certainty,
  concat('track:', $a, '@', arg_min(frame, metres), ' track:', $b, '@', arg_min(frame, metres)) AS explain
FROM pairs GROUP BY recording ORDER BY recording
"""

HEATMAP = """
-- seconds that feet spent in each square; x and y are its upper left corner
WITH steps AS (
  SELECT recording, frame, lead(t) OVER (PARTITION BY recording ORDER BY frame) - t AS seconds FROM frames
  WHERE true$only)
SELECT recording, CAST(floor((x + w / 2) / $cell) AS INTEGER) * $cell AS x,
  CAST(floor((y + h) / $cell) AS INTEGER) * $cell AS y, round(sum(least(seconds, 1.0)), 3) AS seconds,
  count(DISTINCT track) AS individuals
FROM (FROM tracks WHERE present AND $whose$only) JOIN steps USING (recording, frame)
GROUP BY ALL HAVING sum(seconds) > 0 ORDER BY recording, y, x
"""
