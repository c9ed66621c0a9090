"use strict";
(() => {
  const D = JSON.parse(document.getElementById("data").textContent);
  const $ = (id) => document.getElementById(id);
  const css = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
  const PAGE = 300;
  const CONFIG = {
    responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"],
    displayModeBar: innerWidth < 600 ? false : "hover",
  };
  const SERVED = Boolean(D.server.api);
  let view = "targets";
  let limit = PAGE;
  let now = D.begin_frame;
  let timer = 0;
  let single = null;
  let asked = 0;

  function element(tag, text) {
    const node = document.createElement(tag);
    if (text !== undefined) node.textContent = text;
    return node;
  }

  // ---- times: seconds, from ten minutes on h:mm:ss -------------------------------------------------------------
  const LONG = D.seconds - D.begins >= 600;
  function clock(t, digits = 2) {
    if (!LONG) return `${t.toFixed(digits)} s`;
    const whole = Math.floor(t);
    const two = (n) => String(n).padStart(2, "0");
    return `${Math.floor(whole / 3600)}:${two(Math.floor(whole / 60) % 60)}:${two(whole % 60)}`;
  }
  function timeOf(frame) {
    let low = 0;
    let high = D.times.length - 1;
    if (high < 0) return 0;
    while (high - low > 1) {
      const middle = (low + high) >> 1;
      if (D.times[middle][0] <= frame) low = middle; else high = middle;
    }
    const [f, t] = D.times[low];
    const [g, u] = D.times[high];
    return g > f ? t + ((u - t) * (frame - f)) / (g - f) : t;
  }
  function wall(t) {
    if (D.start_ms === null) return "";
    const local = new Date(D.start_ms + Math.round(t * 1000) + D.zone_minutes * 60000).toISOString();
    const zone = D.zone_minutes === 0 ? "UTC" : `UTC${D.zone_minutes > 0 ? "+" : "-"}` +
      [Math.floor(Math.abs(D.zone_minutes) / 60), Math.abs(D.zone_minutes) % 60].map((n) => String(n).padStart(2, "0")).join(":");
    return `${local.slice(0, 10)} ${local.slice(11, 19)} ${zone}`;
  }
  function ticks(begin, end) {
    if (!LONG) return {};
    const steps = [60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400];
    const step = steps.find((s) => (end - begin) / s <= (innerWidth < 600 ? 4 : 10)) || 86400;
    const at = [];
    for (let t = Math.ceil(begin / step) * step; t <= end; t += step) at.push(t);
    return { tickvals: at, ticktext: at.map((t) => clock(t)) };
  }

  // ---- theme -------------------------------------------------------------------------------------------------
  const root = document.documentElement;
  root.dataset.theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
  $("theme").addEventListener("click", () => {
    root.dataset.theme = root.dataset.theme === "dark" ? "light" : "dark";
    drawAll();
    moveTo(now);
  });
  function layout(more) {
    const axis = { gridcolor: css("--line"), zerolinecolor: css("--line"), linecolor: css("--line") };
    return Object.assign({
      paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)",
      font: { color: css("--ink"), family: "system-ui, sans-serif", size: 12 },
      margin: { l: 56, r: 12, t: 8, b: 40 }, hovermode: "closest",
      legend: { orientation: "h", y: 1.02, yanchor: "bottom", x: 0 },
      modebar: { bgcolor: "rgba(0,0,0,0)", color: css("--soft"), activecolor: css("--accent") },
      hoverlabel: { bgcolor: css("--panel"), bordercolor: css("--line"), font: { color: css("--ink") } },
    }, more, { xaxis: Object.assign({}, axis, more.xaxis), yaxis: Object.assign({}, axis, more.yaxis) });
  }

  // ---- figures and facts -------------------------------------------------------------------------------------
  for (const [name, value] of D.figures) {
    const box = element("div");
    box.append(element("dt", name), element("dd", typeof value === "number" ? value.toLocaleString("en") : value));
    $("figures").append(box);
  }
  $("warning").textContent = D.warning;
  $("warning").hidden = !D.warning;
  for (const [name, value] of D.facts) {
    const row = element("tr");
    row.append(element("th", name), element("td", value));
    $("facts").tBodies[0].append(row);
  }

  // ---- the moment: picture, boxes, graph and timeline move together -------------------------------------------
  const pictures = D.thumbnails;
  const steps = new Map(D.steps.map((step) => [step.frame, step]));
  const colours = new Map(D.tracks.map((t) => [t.id, t.colour]));
  const corrected = new Set(D.corrections.filter((c) => !c[9]).flatMap((c) => c[2]));
  const SVG = "http://www.w3.org/2000/svg";
  const [width, height] = D.size;
  $("stage").style.setProperty("--shape", `${width}/${height}`);
  $("desk").style.setProperty("--ratio", String(width / height));

  function nearest(list, frameOf, frame) {
    let low = 0;
    let high = list.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (frameOf(list[middle]) < frame) low = middle + 1; else high = middle;
    }
    if (low > 0 && frame - frameOf(list[low - 1]) <= frameOf(list[low]) - frame) low -= 1;
    return low;
  }
  const nearestPicture = (frame) => nearest(pictures, (p) => p[0], frame);
  const nearestStep = (frame) => D.steps[nearest(D.steps, (step) => step.frame, frame)];

  function shape(tag, attributes, parent) {
    const node = document.createElementNS(SVG, tag);
    for (const [name, value] of Object.entries(attributes)) node.setAttribute(name, String(value));
    parent.append(node);
    return node;
  }
  function drawBoxes(step) {
    const svg = $("overlay");
    svg.replaceChildren();
    svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
    const size = (12 * width) / Math.max(svg.clientWidth, 1);
    const middle = new Map(step.nodes.map(([id, x, y, w, h]) => [id, [x + w / 2, y + h / 2]]));
    for (const [a, b, state] of step.edges) {
      if (!middle.has(a) || !middle.has(b) || (single !== null && a !== single && b !== single)) continue;
      const [[x1, y1], [x2, y2]] = [middle.get(a), middle.get(b)];
      shape("line", { x1, y1, x2, y2, class: state === "JOINT" ? "edge joint" : "edge" }, svg);
    }
    for (const [id, x, y, w, h, seen] of step.nodes) {
      const aside = single !== null && id !== single;
      const group = shape("g", { class: (seen ? "" : "guessed ") + (aside ? "aside" : ""), "data-id": id }, svg);
      shape("rect", { x, y, width: w, height: h, class: "halo" }, group);
      shape("rect", { x, y, width: w, height: h, class: "box", stroke: colours.get(id) || "#888" }, group);
      // Above the head where there is room, else below the feet: never over the body.
      const above = y - size * 0.35 > size;
      const label = shape("text", { x, y: above ? y - size * 0.35 : Math.min(y + h + size, height - 2) }, group);
      label.style.fontSize = `${size}px`;
      label.style.strokeWidth = `${size / 4}px`;
      label.textContent = nameOf(id);
    }
    svg.setAttribute("aria-label", step.nodes.length ? `targets ${step.nodes.map((n) => n[0]).join(", ")}` : "no targets");
  }
  const names = new Map(D.labels);
  function nameOf(id) {
    const label = names.get(id);
    return `${id}${label ? " " + label : ""}${corrected.has(id) ? " \u270e" : ""}`;
  }
  function caption(frame, wanted) {
    const t = timeOf(frame);
    const off = frame - wanted;
    const other = off === 0 ? "" : ` \u2013 the nearest picture to frame ${wanted}, which has none here: ${Math.abs(timeOf(frame) - timeOf(wanted)).toFixed(2)} s ${off < 0 ? "earlier" : "later"}`;
    $("caption").textContent = `${clock(t)}${wall(t) ? ", " + wall(t) : ""}, frame ${frame}${other}`;
    $("viewer").dataset.frame = String(frame);
  }
  function showPicture(wanted) {
    if (SERVED) {
      const turn = ++asked;
      fetch(`${D.server.api}frame/${wanted}`).then((r) => r.json()).then((step) => {
        if (turn !== asked || step.error) return;
        if (D.server.pictures) $("thumbnail").src = `${D.server.api}picture/${step.frame}.jpg`;
        $("thumbnail").alt = `frame ${step.frame} as it was recorded`;
        caption(step.frame, wanted);
        drawBoxes(step);
        drawGraph(step);
      }).catch(() => { $("caption").textContent = "scenetrace view has ended: start it again."; });
      return;
    }
    let frame = wanted;
    if (pictures.length) {
      const [found, source] = pictures[nearestPicture(wanted)];
      frame = found;
      $("thumbnail").src = source;
      $("thumbnail").alt = `frame ${frame} as it was recorded`;
    } else if (D.steps.length) frame = nearestStep(wanted).frame;
    const step = steps.get(frame) || nearestStep(frame);
    caption(frame, wanted);
    if (!pictures.length) $("caption").textContent += " \u2013 this log holds no pictures";
    if (step) { drawBoxes(step); drawGraph(step); }
  }
  function moveTo(frame, quietly) {
    now = Math.min(Math.max(frame, Number($("slider").min)), Number($("slider").max));
    $("slider").value = String(now);
    const t = timeOf(now);
    $("moment").textContent = `${clock(t)}, frame ${now}`;
    $("slider").setAttribute("aria-valuetext", $("moment").textContent);
    showPicture(now);
    moveCursor(t);
    if (!quietly) markEvent();
  }
  function showFrame(frame) {
    moveTo(frame);
    const box = $("desk").getBoundingClientRect();
    if (box.bottom < 80 || box.top > innerHeight - 80) $("desk").scrollIntoView({ block: "nearest" });
  }
  function stepped(by) {
    if (SERVED || !pictures.length) return moveTo(now + by);
    const at = nearestPicture(now);
    const next = pictures[at][0] === now || Math.sign(pictures[at][0] - now) !== by ? at + by : at;
    moveTo(pictures[Math.min(Math.max(next, 0), pictures.length - 1)][0]);
  }
  $("previous").addEventListener("click", () => stepped(-1));
  $("next").addEventListener("click", () => stepped(1));
  $("slider").addEventListener("input", () => moveTo(Number($("slider").value)));
  function frameAt(t) {
    const k = nearest(D.times, (p) => p[1], t);
    const [f, u] = D.times[k];
    const [g, v] = D.times[Math.min(k + (t >= u ? 1 : 0), D.times.length - 1)];
    return v > u ? Math.round(f + ((g - f) * (t - u)) / (v - u)) : f;
  }
  function play() {
    if (timer) {
      clearInterval(timer);
      timer = 0;
    } else {
      if (now >= Number($("slider").max)) moveTo(Number($("slider").min));
      let t = timeOf(now);
      let last = performance.now();
      timer = setInterval(() => {
        const at = performance.now();
        t += ((at - last) / 1000) * Number($("speed").value);
        last = at;
        const frame = t >= D.seconds ? Number($("slider").max) : Math.max(frameAt(t), now);
        if (frame !== now) moveTo(frame, true);
        if (t >= D.seconds) play();
      }, 100);
    }
    $("play").textContent = timer ? "pause" : "play";
    $("play").setAttribute("aria-pressed", String(Boolean(timer)));
  }
  $("play").addEventListener("click", play);
  $("enlarge").addEventListener("click", () => {
    const large = $("desk").dataset.large !== "true";
    $("desk").dataset.large = String(large);
    $("enlarge").setAttribute("aria-pressed", String(large));
    Plotly.Plots.resize("graph");
    moveTo(now);
  });
  addEventListener("keydown", (e) => {
    if (e.ctrlKey || e.metaKey || e.altKey || e.target.closest("input,select,textarea,button,[tabindex]")) return;
    const act = { " ": play, ArrowLeft: () => stepped(-1), ArrowRight: () => stepped(1), b: () => addNote("") }[e.key];
    if (!act) return;
    e.preventDefault();
    act();
  });

  // ---- one target singled out ----------------------------------------------------------------------------------
  for (const { id } of D.tracks) {
    const option = element("option", `target ${nameOf(id)}`);
    option.value = String(id);
    $("single").append(option);
  }
  function singleOut(id) {
    single = id;
    $("single").value = id === null ? "" : String(id);
    limit = PAGE;
    drawAll();
    drawEvents();
    moveTo(now);
  }
  $("single").addEventListener("change", () => singleOut($("single").value === "" ? null : Number($("single").value)));
  $("overlay").addEventListener("click", (e) => {
    const group = e.target.closest("g");
    const id = group ? Number(group.dataset.id) : null;
    singleOut(id === single ? null : id);
  });

  // ---- trajectories ------------------------------------------------------------------------------------------
  function scene(more) {
    const dark = root.dataset.theme === "dark";
    return layout(Object.assign({
      xaxis: { range: [0, width], constrain: "domain", showgrid: false, zeroline: false },
      yaxis: { range: [height, 0], scaleanchor: "x", constrain: "domain", showgrid: false, zeroline: false },
      margin: { l: 36, r: 8, t: 8, b: 28 }, showlegend: false,
      images: D.ground ? [{
        source: D.ground, xref: "x", yref: "y", x: 0, y: 0, sizex: width, sizey: height, sizing: "stretch",
        layer: "below", opacity: dark ? 0.45 : 0.55,
      }] : [],
    }, more));
  }
  function drawPaths() {
    const traces = D.tracks.map((track) => ({
      type: "scatter", mode: "lines+markers", name: `target ${track.id}`,
      x: track.path.map((p) => p[0]), y: track.path.map((p) => p[1]), customdata: track.path.map((p) => p[2]),
      opacity: single === null || single === track.id ? 1 : 0.12,
      line: { color: track.colour, width: 2 },
      marker: { color: track.colour, size: track.path.map((_, k) => (k === 0 ? 9 : 3)), line: { width: 0 } },
      text: track.path.map((p) => clock(timeOf(p[2]))),
      hovertemplate: "target " + track.id + ", %{text}, frame %{customdata}<extra></extra>",
    }));
    Plotly.react("paths", traces, scene({}), CONFIG);
  }

  // ---- timeline ----------------------------------------------------------------------------------------------
  const STATES = {
    targets: [["present", "--present"], ["in a group", "--group"]],
    relations: [["INTERACTION", "--interaction"], ["JOINT", "--joint"]],
    groups: [["group", "--group"]],
    encounters: [["meeting", "--meeting"], ["moving", "--moving"], ["contact", "--contact"], ["separation", "--separation"]],
  };
  const PATTERNS = { JOINT: "", INTERACTION: "/", moving: "/", contact: "x", separation: "." };
  function intervals() {
    const pair = (a, b) => `${a} - ${b}`;
    if (view === "relations") {
      return D.relations.map(([a, b, state, s, e, st, et]) => [pair(a, b), state, s, e, st, et, `${a} and ${b}: ${state}`, [a, b]]);
    }
    if (view === "groups") {
      return D.groups.map(([id, members, s, e, st, et, end]) =>
        [`group ${id}`, "group", s, e, st, et, `group ${id}: ${members.join(", ")}${end ? "; " + end : ""}`, members]);
    }
    if (view === "encounters") {
      return D.encounters.map(([a, b, kind, s, e, st, et, c]) =>
        [pair(a, b), kind, s, e, st, et, `${a} and ${b}: ${kind}, confidence ${c.toFixed(2)}`, [a, b]]);
    }
    const out = D.presence.map(([id, s, e, st, et]) => [`target ${id}`, "present", s, e, st, et, `target ${id} is present`, [id]]);
    for (const [id, members, s, e, st, et] of D.groups) {
      for (const m of members) out.push([`target ${m}`, "in a group", s, e, st, et, `target ${m} in group ${id}: ${members.join(", ")}`, [m]]);
    }
    return out;
  }
  const TABLES = { targets: ["presence", "groups"], relations: ["relations"], groups: ["groups"], encounters: ["encounters"] };
  function drawTimeline() {
    const rows = intervals().filter((r) => single === null || r[7].includes(single));
    const cut = TABLES[view].filter((t) => D.in_all[t] > D[t].length)
      .map((t) => `the ${D[t].length} longest of ${D.in_all[t]} rows of ${t} are shown`);
    $("cut").textContent = cut.length ? `${cut.join("; ")}; \`scenetrace query\` has all.` : "";
    const lanes = [...new Set(rows.map((r) => r[0]))];
    const [first, begin] = D.times[0] || [0, 0], [last, end] = D.times[D.times.length - 1] || [0, 0];
    const step = last > first && end > begin ? (end - begin) / (last - first) : 0.04;
    const traces = STATES[view].map(([state, colour]) => {
      const mine = rows.filter((r) => r[1] === state);
      return {
        type: "bar", orientation: "h", name: state, y: mine.map((r) => r[0]), base: mine.map((r) => r[4]),
        x: mine.map((r) => r[5] - r[4] + step), customdata: mine.map((r) => [r[2], r[3], clock(r[5]), r[6], clock(r[4])]),
        marker: { color: css(colour), line: { width: 0 }, pattern: { shape: PATTERNS[state] || "", size: 6, solidity: 0.3, fillmode: "overlay", fgcolor: css("--ground") } },
        width: state === "present" ? 0.3 : 0.76,
        hovertemplate: "%{customdata[3]}<br>%{customdata[4]} to %{customdata[2]}, frames %{customdata[0]} to %{customdata[1]}<extra></extra>",
      };
    });
    const tall = Math.max(150, 90 + lanes.length * 20);
    $("timeline").style.height = `${tall}px`;
    Plotly.react("timeline", traces, layout({
      barmode: "overlay", height: tall, margin: { l: 74, r: 12, t: 74, b: 12 },
      legend: { orientation: "h", y: 1, yref: "container", yanchor: "top", x: 0 },
      xaxis: Object.assign({ title: { text: LONG ? "time from the start" : "seconds from the start" }, side: "top",
        range: [D.begins, Math.max(D.seconds, D.begins + step)] }, ticks(D.begins, D.seconds)),
      yaxis: { categoryorder: "array", categoryarray: lanes.slice().reverse(), fixedrange: true, type: "category", automargin: true },
      annotations: rows.length ? [] : [{ text: "none in this recording", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }],
    }), CONFIG);
    moveCursor(timeOf(now));
  }
  function moveCursor(t) {
    const drawn = $("timeline")._fullLayout;
    if (!drawn || !drawn.xaxis || !drawn.xaxis.l2p) return;
    const x = drawn.xaxis.l2p(t);
    $("cursor").hidden = !(x >= 0 && x <= drawn.xaxis._length);
    $("cursor").style.left = `${drawn.xaxis._offset + x}px`;
    $("cursor").style.height = $("timeline").style.height;
  }
  for (const button of $("views").querySelectorAll("button")) {
    button.addEventListener("click", () => {
      view = button.dataset.view;
      for (const other of $("views").querySelectorAll("button")) other.setAttribute("aria-pressed", String(other === button));
      drawTimeline();
    });
  }

  // ---- the graph over time -----------------------------------------------------------------------------------
  function drawGraph(step) {
    const places = new Map(step.nodes.map(([id, x, y, w, h]) => [id, [x + w / 2, y + h / 2]]));
    const edges = (state, colour, thick) => {
      const x = [];
      const y = [];
      for (const [a, b, s] of step.edges) {
        if (s !== state || !places.has(a) || !places.has(b)) continue;
        x.push(places.get(a)[0], places.get(b)[0], null);
        y.push(places.get(a)[1], places.get(b)[1], null);
      }
      return { type: "scatter", mode: "lines", name: state, x, y, hoverinfo: "skip", showlegend: true,
        line: { color: css(colour), width: thick, dash: state === "JOINT" ? "solid" : "dot" } };
    };
    const ids = step.nodes.map((n) => n[0]);
    const nodes = {
      type: "scatter", mode: "markers+text", name: "targets", x: ids.map((id) => places.get(id)[0]), y: ids.map((id) => places.get(id)[1]),
      text: ids.map(String), textposition: "middle center", textfont: { color: "#fff", size: innerWidth < 600 ? 9 : 11 },
      customdata: ids.map(() => step.frame), showlegend: false,
      marker: { size: innerWidth < 600 ? 16 : 22, color: ids.map((id) => colours.get(id) || "#888"), line: { color: css("--ground"), width: 1 },
        opacity: ids.map((id) => (single === null || id === single ? 1 : 0.2)) },
      hovertemplate: "target %{text}<extra></extra>",
    };
    Plotly.react("graph", [edges("INTERACTION", "--interaction", 3), edges("JOINT", "--joint", 6), nodes],
      scene({ showlegend: true, margin: { l: 36, r: 8, t: 30, b: 28 } }), CONFIG);
    $("graph").dataset.frame = String(step.frame);
  }

  // ---- events ------------------------------------------------------------------------------------------------
  const kinds = [...new Set(D.events.map((e) => e[1]))].sort();
  for (const kind of ["", ...kinds]) {
    const option = element("option", kind || "all kinds");
    option.value = kind;
    $("kind").append(option);
  }
  const quiet = new Set(D.quiet);
  function matches(event, kind, words) {
    if (kind ? event[1] !== kind : !$("all").checked && quiet.has(event[1])) return false;
    if (single !== null && !event[4].includes(single)) return false;
    const text = `${event[0]} ${event[1]} ${event[5]} ${event[6]} ${event[4].map((s) => "target " + s).join(" ")}`.toLowerCase();
    return words.every((w) => text.includes(w));
  }
  function drawEvents() {
    const words = $("search").value.toLowerCase().split(/\s+/).filter(Boolean);
    const phrase = words.length > 1 ? [words.join(" ")] : words;
    let found = D.events.filter((e) => matches(e, $("kind").value, phrase));
    if (!found.length && words.length > 1) found = D.events.filter((e) => matches(e, $("kind").value, words));
    const body = $("events").tBodies[0];
    body.replaceChildren();
    for (const [id, kind, frame, t, subjects, text, rule] of found.slice(0, limit)) {
      const row = element("tr");
      row.tabIndex = 0;
      row.dataset.frame = String(frame);
      row.title = wall(t);
      for (const cell of [id, clock(t).replace(" s", ""), frame, kind.replaceAll("_", "_\u200b"), subjects.map(nameOf).join(", "), text, rule]) row.append(element("td", String(cell)));
      if (subjects.some((s) => corrected.has(s))) {
        row.cells[4].className = "corrected";
        row.cells[4].title = "corrected by hand: see below";
      }
      body.append(row);
    }
    const left = D.events_left_out ? `; ${D.events_left_out} more are in the log, not in this page` : "";
    const hidden = $("all").checked || $("kind").value ? 0 : D.events.filter((e) => quiet.has(e[1])).length;
    const own = hidden ? `; ${hidden} that trackers say of themselves are not shown` : "";
    $("count").textContent = `${found.length} of ${D.events.length} events${own}${left}`;
    if (!found.length) {
      const cell = element("td", D.events.length ? "No event fits the filter." : "Nothing happened in this recording.");
      cell.colSpan = 7;
      const row = element("tr");
      row.append(cell);
      body.append(row);
    }
    $("more").hidden = found.length <= limit;
  }
  function pick(row) {
    if (!row || !row.dataset.frame) return;
    showFrame(Number(row.dataset.frame));
  }
  $("events").tBodies[0].addEventListener("click", (e) => pick(e.target.closest("tr")));
  $("events").tBodies[0].addEventListener("keydown", (e) => { if (e.key === "Enter") pick(e.target.closest("tr")); });
  $("all").addEventListener("change", () => { limit = PAGE; drawEvents(); });
  function markEvent() {
    for (const row of $("events").tBodies[0].rows) {
      if (row.dataset.frame === String(now)) row.setAttribute("aria-current", "true"); else row.removeAttribute("aria-current");
    }
  }
  $("kind").addEventListener("change", () => { limit = PAGE; drawEvents(); });
  $("search").addEventListener("input", () => { limit = PAGE; drawEvents(); });
  $("more").addEventListener("click", () => { limit += PAGE; drawEvents(); });

  // ---- bookmarks and notes: with the case where it is served, else in this browser and as a file ---------------
  const KEY = `scenetrace notes ${D.facts.map((f) => f[1]).join(" ")}`;
  const kept = () => { try { return JSON.parse(localStorage.getItem(KEY) || "[]"); } catch { return []; } };
  let notes = D.notes.slice();
  let own = SERVED ? [] : kept().filter((n) => Number.isInteger(n.frame) && typeof n.text === "string");
  const writable = !SERVED || D.server.edit;
  $("note-form").hidden = !writable;
  $("bookmark").hidden = !writable;
  $("notes-save").hidden = SERVED;
  $("notes-where").textContent = !SERVED
    ? "Kept in this browser alone; \u201csave as file\u201d makes the notes.jsonl of a case of them."
    : writable ? "Written into the case\u2019s notes at once." : "Read only: start scenetrace view with --edit to add some.";
  function drawNotes() {
    $("notes").replaceChildren();
    for (const note of [...notes, ...own].sort((a, b) => a.frame - b.frame)) {
      const row = element("li");
      const go = element("button", `${clock(note.t)}, frame ${note.frame}`);
      go.type = "button";
      go.addEventListener("click", () => showFrame(note.frame));
      row.append(go, element("span", [note.text || "bookmark", note.by ? `(${note.by}${note.date ? ", " + note.date : ""})` : ""].join(" ")));
      $("notes").append(row);
    }
  }
  function post(what, body) {
    return fetch(`${D.server.api}${what}`, { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) })
      .then((r) => r.json()).catch(() => ({ error: "scenetrace view has ended: start it again" }));
  }
  function addNote(text) {
    if (!writable) return;
    const note = { recording: D.recording, frame: now, t: Number(timeOf(now).toFixed(3)), text, by: $("note-by").value.trim(), date: $("note-date").value };
    if (SERVED) {
      post("note", note).then((said) => {
        if (said.error) $("notes-where").textContent = said.error; else { notes = said.notes; drawNotes(); }
      });
      return;
    }
    own.push(note);
    try { localStorage.setItem(KEY, JSON.stringify(own)); } catch { $("notes-where").textContent = "This browser keeps nothing: save the notes as a file."; }
    drawNotes();
  }
  $("bookmark").addEventListener("click", () => addNote(""));
  $("note-form").addEventListener("submit", (e) => {
    e.preventDefault();
    addNote($("note-text").value.trim());
    $("note-text").value = "";
  });
  $("notes-save").addEventListener("click", () => {
    const text = [...notes, ...own].map((n) => JSON.stringify(n) + "\n").join("");
    const link = element("a");
    link.href = URL.createObjectURL(new Blob([text], { type: "application/x-ndjson" }));
    link.download = "notes.jsonl";
    link.click();
    URL.revokeObjectURL(link.href);
  });

  // ---- corrections -----------------------------------------------------------------------------------------------
  function drawCorrections(rows, pending) {
    $("corrections").replaceChildren();
    $("corrections-none").hidden = rows.length > 0;
    for (const [number, , , frame, , text, by, why, date, undone] of rows) {
      const row = element("li");
      row.value = number;
      const said = element("span", `${text}: ${why} (${by}${date ? ", " + date : ""})${pending.has(number) ? " \u2013 not replayed yet" : ""}`);
      if (undone) said.className = "gone";
      row.append(said);
      if (frame !== null) {
        const go = element("button", "show");
        go.type = "button";
        go.setAttribute("aria-label", `show correction ${number}`);
        go.addEventListener("click", () => showFrame(frame));
        row.prepend(go);
      }
      $("corrections").append(row);
    }
  }
  drawCorrections(D.corrections, new Set());
  if (D.server.edit) {
    $("correct-form").hidden = false;
    for (const [name, takes] of D.server.takes) {
      const option = element("option", name);
      option.value = name;
      option.title = takes;
      $("correct-do").append(option);
    }
    drawCorrections(D.server.corrections, new Set(D.server.pending));
    $("correct-form").addEventListener("submit", (e) => {
      e.preventDefault();
      post("correct", {
        do: $("correct-do").value, words: $("correct-words").value, by: $("correct-by").value, why: $("correct-why").value, date: $("correct-date").value,
        frame: $("correct-at").checked ? now : null,
      }).then((said) => {
        $("correct-said").textContent = said.error || said.told;
        if (!said.error) drawCorrections(said.corrections, new Set(said.pending));
      });
    });
    $("correct-do").addEventListener("change", () => { $("correct-said").textContent = $("correct-do").selectedOptions[0].title; });
    $("single").addEventListener("change", () => { if ($("single").value && !$("correct-words").value) $("correct-words").value = $("single").value; });
  }

  // ---- questions -------------------------------------------------------------------------------------------------
  $("ask").hidden = !SERVED;
  $("ask-form").addEventListener("submit", (e) => {
    e.preventDefault();
    $("ask-said").textContent = "asking ...";
    post("query", { sql: $("ask-sql").value }).then((said) => {
      const table = $("answer");
      table.tHead.replaceChildren();
      table.tBodies[0].replaceChildren();
      $("ask-said").textContent = said.error || `${said.rows.length} rows${said.more ? ", the first of more" : ""}`;
      if (said.error) return;
      const head = element("tr");
      for (const name of said.columns) {
        const cell = element("th", name);
        cell.scope = "col";
        head.append(cell);
      }
      table.tHead.append(head);
      for (const values of said.rows) {
        const row = element("tr");
        for (const value of values) row.append(element("td", value));
        table.tBodies[0].append(row);
      }
    });
  });

  // ---- start -------------------------------------------------------------------------------------------------
  $("case").hidden = !D.case.title && !D.case.reference && !D.case.examiner;
  $("case-title").textContent = [D.case.reference, D.case.title].filter(Boolean).join(": ") || "Case";
  $("case-note").textContent = [D.case.examiner, D.case.date, D.case.note].filter(Boolean).join(" \u2013 ");
  function drawAll() {
    drawPaths();
    drawTimeline();
  }
  $("slider").min = String(D.begin_frame);
  $("slider").max = String(D.end_frame);
  drawAll();
  drawEvents();
  drawNotes();
  drawGraph({ frame: D.begin_frame, nodes: [], edges: [] });
  moveTo(D.begin_frame);
  $("timeline").on("plotly_relayout", () => moveCursor(timeOf(now)));
  addEventListener("resize", () => setTimeout(() => moveTo(now, true), 200));
  const frameOf = (data) => (Array.isArray(data) ? data[0] : data);
  for (const id of ["paths", "timeline"]) {
    $(id).on("plotly_click", (event) => {
      const data = event.points[0].customdata;
      if (data !== undefined) showFrame(frameOf(data));
    });
  }
  $("graph").on("plotly_click", (event) => {
    const id = Number(event.points[0].text);
    singleOut(id === single ? null : id);
  });
  root.dataset.ready = "true";
})();
