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
  let view = "targets";
  let limit = PAGE;
  let shown = 0;
  let timer = 0;

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

  // ---- the frame viewer --------------------------------------------------------------------------------------
  const pictures = D.thumbnails;
  function nearest(frame) {
    let low = 0;
    let high = pictures.length - 1;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (pictures[middle][0] < frame) low = middle + 1; else high = middle;
    }
    if (low > 0 && frame - pictures[low - 1][0] <= pictures[low][0] - frame) low -= 1;
    return low;
  }
  function showPicture(index, wanted) {
    if (!pictures.length) {
      $("caption").textContent = "This log holds no pictures.";
      return;
    }
    shown = Math.min(Math.max(index, 0), pictures.length - 1);
    const [frame, source] = pictures[shown];
    $("thumbnail").src = source;
    $("thumbnail").alt = `frame ${frame} with overlays`;
    const close = wanted === undefined || wanted === frame ? "" : ` (nearest picture to frame ${wanted})`;
    $("caption").textContent = `${clock(timeOf(frame))}, frame ${frame}${close}`;
    $("viewer").dataset.frame = String(frame);
  }
  function showFrame(frame) {
    showPicture(nearest(frame), frame);
    const box = $("viewer-section").getBoundingClientRect();
    if (box.bottom < 0 || box.top > innerHeight) $("viewer-section").scrollIntoView({ block: "nearest" });
  }
  $("previous").addEventListener("click", () => showPicture(shown - 1));
  $("next").addEventListener("click", () => showPicture(shown + 1));

  // ---- trajectories ------------------------------------------------------------------------------------------
  const [width, height] = D.size;
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
      return D.relations.map(([a, b, state, s, e, st, et]) => [pair(a, b), state, s, e, st, et, `${a} and ${b}: ${state}`]);
    }
    if (view === "groups") {
      return D.groups.map(([id, members, s, e, st, et, end]) =>
        [`group ${id}`, "group", s, e, st, et, `group ${id}: ${members.join(", ")}${end ? "; " + end : ""}`]);
    }
    if (view === "encounters") {
      return D.encounters.map(([a, b, kind, s, e, st, et, c]) =>
        [pair(a, b), kind, s, e, st, et, `${a} and ${b}: ${kind}, confidence ${c.toFixed(2)}`]);
    }
    const out = D.presence.map(([id, s, e, st, et]) => [`target ${id}`, "present", s, e, st, et, `target ${id} is present`]);
    for (const [id, members, s, e, st, et] of D.groups) {
      for (const m of members) out.push([`target ${m}`, "in a group", s, e, st, et, `target ${m} in group ${id}: ${members.join(", ")}`]);
    }
    return out;
  }
  const TABLES = { targets: ["presence", "groups"], relations: ["relations"], groups: ["groups"], encounters: ["encounters"] };
  function drawTimeline() {
    const rows = intervals();
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
    const tall = Math.max(260, 90 + lanes.length * 20);
    $("timeline").style.height = `${tall}px`;
    Plotly.react("timeline", traces, layout({
      barmode: "overlay", height: tall, margin: { l: 74, r: 12, t: 74, b: 12 },
      legend: { orientation: "h", y: 1, yref: "container", yanchor: "top", x: 0 },
      xaxis: Object.assign({ title: { text: LONG ? "time from the start" : "seconds from the start" }, side: "top",
        range: [D.begins, Math.max(D.seconds, D.begins + step)] }, ticks(D.begins, D.seconds)),
      yaxis: { categoryorder: "array", categoryarray: lanes.slice().reverse(), fixedrange: true, type: "category", automargin: true },
      annotations: rows.length ? [] : [{ text: "none in this recording", showarrow: false, xref: "paper", yref: "paper", x: 0.5, y: 0.5 }],
    }), CONFIG);
  }
  for (const button of $("views").querySelectorAll("button")) {
    button.addEventListener("click", () => {
      view = button.dataset.view;
      for (const other of $("views").querySelectorAll("button")) other.setAttribute("aria-pressed", String(other === button));
      drawTimeline();
    });
  }

  // ---- the graph over time -----------------------------------------------------------------------------------
  const colours = new Map(D.tracks.map((t) => [t.id, t.colour]));
  function drawGraph() {
    const step = D.steps[Number($("slider").value)];
    if (!step) return;
    const places = new Map(step.nodes.map(([id, x, y]) => [id, [x, y]]));
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
    const nodes = {
      type: "scatter", mode: "markers+text", name: "targets", x: step.nodes.map((n) => n[1]), y: step.nodes.map((n) => n[2]),
      text: step.nodes.map((n) => String(n[0])), textposition: "middle center", textfont: { color: "#fff", size: innerWidth < 600 ? 9 : 11 },
      customdata: step.nodes.map(() => step.frame), showlegend: false,
      marker: { size: innerWidth < 600 ? 16 : 22, color: step.nodes.map((n) => colours.get(n[0]) || "#888"), line: { color: css("--ground"), width: 1 } },
      hovertemplate: "target %{text}<extra></extra>",
    };
    Plotly.react("graph", [edges("INTERACTION", "--interaction", 3), edges("JOINT", "--joint", 6), nodes],
      scene({ showlegend: true, margin: { l: 36, r: 8, t: 30, b: 28 } }), CONFIG);
    $("moment").textContent = `${clock(step.t)}, frame ${step.frame}`;
    $("graph").dataset.frame = String(step.frame);
  }
  $("slider").max = String(Math.max(0, D.steps.length - 1));
  $("slider").addEventListener("input", drawGraph);
  $("slider").addEventListener("change", () => {
    const step = D.steps[Number($("slider").value)];
    if (step) showPicture(nearest(step.frame), step.frame);
  });
  $("play").addEventListener("click", () => {
    if (timer) {
      clearInterval(timer);
      timer = 0;
      $("play").textContent = "play";
      return;
    }
    $("play").textContent = "pause";
    timer = setInterval(() => {
      const last = Number($("slider").max);
      $("slider").value = String(Number($("slider").value) >= last ? 0 : Number($("slider").value) + 1);
      drawGraph();
    }, 120);
  });

  // ---- events ------------------------------------------------------------------------------------------------
  const kinds = [...new Set(D.events.map((e) => e[1]))].sort();
  for (const kind of ["", ...kinds]) {
    const option = element("option", kind || "all kinds");
    option.value = kind;
    $("kind").append(option);
  }
  function matches(event, kind, words) {
    if (kind && event[1] !== kind) return false;
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
      for (const cell of [id, clock(t).replace(" s", ""), frame, kind.replaceAll("_", "_\u200b"), subjects.join(", "), text, rule]) row.append(element("td", String(cell)));
      body.append(row);
    }
    const left = D.events_left_out ? `; ${D.events_left_out} more are in the log, not in this page` : "";
    $("count").textContent = `${found.length} of ${D.events.length} events${left}`;
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
    for (const other of $("events").tBodies[0].rows) other.removeAttribute("aria-selected");
    row.setAttribute("aria-selected", "true");
    showFrame(Number(row.dataset.frame));
  }
  $("events").tBodies[0].addEventListener("click", (e) => pick(e.target.closest("tr")));
  $("events").tBodies[0].addEventListener("keydown", (e) => { if (e.key === "Enter") pick(e.target.closest("tr")); });
  $("kind").addEventListener("change", () => { limit = PAGE; drawEvents(); });
  $("search").addEventListener("input", () => { limit = PAGE; drawEvents(); });
  $("more").addEventListener("click", () => { limit += PAGE; drawEvents(); });

  // ---- start -------------------------------------------------------------------------------------------------
  function drawAll() {
    drawPaths();
    drawTimeline();
    drawGraph();
  }
  drawAll();
  drawEvents();
  showPicture(0);
  const frameOf = (data) => (Array.isArray(data) ? data[0] : data);
  for (const id of ["paths", "timeline", "graph"]) {
    $(id).on("plotly_click", (event) => {
      const data = event.points[0].customdata;
      if (data !== undefined) showFrame(frameOf(data));
    });
  }
  root.dataset.ready = "true";
})();
