"use strict";
// Shows the documents of a running session. The next one is asked for after the last one is shown, so that a slow
// browser gets fewer of them and never stays behind.
const LOST_AFTER_MS = 2000;
const AGAIN_AFTER_MS = 1000;
const LOOK_MS = 500, BUSY_MS = 1500;
const STALE_AFTER_S = 2, LONG_S = 600;
const at = (id) => document.getElementById(id);
const svg = (name, attributes) => {
  const node = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [key, value] of Object.entries(attributes)) node.setAttribute(key, value);
  return node;
};
const number = (value, digits) => value === null || value === undefined ? "-" : value.toFixed(digits);
const signed = (value, digits) => {
  if (value === null || value === undefined) return "-";
  const size = Math.abs(value).toFixed(digits);
  return (value < 0 && Number(size) ? "−" : "+") + size;
};
let latest = null;
let heardMs = performance.now();
let shownWord = "";

function put(id, text) {
  const node = at(id);
  if (node.textContent !== text) node.textContent = text;
}

function putWord(word, level, detail) {
  put("word-text", word);
  put("detail", detail);
  at("head").className = level;
  fitWord();
  document.title = `${word} - gse`;
  const kind = word.replace(/[0-9].*/, "");
  if (kind !== shownWord && shownWord) sound(kind);
  shownWord = kind;
}

function fitWord() {
  const text = at("word-text");
  text.style.transform = "";
  const room = at("word").clientWidth / text.offsetWidth;
  if (room < 1) text.style.transform = `scaleX(${room.toFixed(3)})`;
}

// A tone on an alarm and on the verdict; a browser allows it after a click only.
let audio = null;
function sound(kind) {
  if (!audio || !/^(NO ANSWER|LINK LOST|CONNECTION LOST|DONE)/.test(kind)) return;
  const pitches = kind.startsWith("DONE") ? [660, 880] : [440, 330];
  pitches.forEach((pitch, turn) => {
    const tone = audio.createOscillator(), gain = audio.createGain();
    tone.frequency.value = pitch;
    gain.gain.value = 0.2;
    tone.connect(gain).connect(audio.destination);
    tone.start(audio.currentTime + 0.3 * turn);
    tone.stop(audio.currentTime + 0.3 * turn + 0.25);
  });
}

// Degrees where arcseconds make no sense, as in a report.
function angle(arcsec, digits) {
  if (arcsec === null || arcsec === undefined) return "-";
  return Math.abs(arcsec) < 3600 ? signed(arcsec, digits) : `${signed(arcsec / 3600, 3)} deg`;
}

function duration(minutes) {
  return minutes < 120 ? `${minutes} min` : `${Math.floor(minutes / 60)} h ${minutes % 60} min`;
}

function show(state) {
  document.body.classList.remove("empty");
  putWord(state.word.text, state.word.level, state.word.detail);
  const isLong = state.since_answer_s >= LONG_S;
  put("since", isLong ? String(Math.floor(state.since_answer_s / 60)) : number(state.since_answer_s, 1));
  const unit = isLong ? "minutes" : "seconds";
  put("since-unit", state.since_answer_s === null ? "none so far" : `${unit} ${state.ended ? "before the last frame" : "ago"}`);
  const stars = state.stars;
  // Far more than are expected: the stars of another camera or another sky than stated.
  const ofExpected = stars.expected !== null && stars.seen <= 1.5 * stars.expected + 1;
  put("stars", stars.seen === null ? "-" : `${stars.seen}/${ofExpected ? stars.expected : stars.objects}`);
  put("stars-of", stars.seen === null ? "no panoramas" : ofExpected ? "of those expected" : "of objects");
  put("magnitude", number(stars.limiting_mag, 1));
  put("magnitude-note", state.sky ? `sky ${state.sky}` : "faintest star seen");
  put("forecast", state.forecast.replace(/^verdict: /, "") || "-");
  put("dawn", state.dawn_min === null ? "none" : state.dawn_min <= 0 ? "bright" : duration(state.dawn_min));
  put("dawn-note", "Sun at −12°");
  put("clock", state.clock ?? "not read");
  put("identified", state.identified === null ? "-" : (100 * state.identified).toFixed(1));
  put("identified-note", `% (limit ${(100 * state.identified_limit).toFixed(0)}), ${state.false_answers} false`);
  at("identified").classList.toggle("outside", state.identified !== null && state.identified < state.identified_limit);
  at("clock").classList.toggle("outside", Boolean(state.clock?.startsWith("NOT")));
  put("disk", number(state.disk_free_gb, 1));
  put("frames", String(state.frames));
  put("frames-note", `${number(state.frames_per_s, 1)}/s, ${state.frames_lost} lost`);
  at("alarms").hidden = !state.alarms.length;
  put("alarm-text", state.alarms.join("; "));
  at("question").hidden = !state.question;
  if (at("question-text").textContent !== state.question) at("answer-problem").textContent = "";
  put("question-text", state.question);
  // What is told can be refused; what is asked has an answer.
  const isTold = state.question.endsWith("no if it cannot be]");
  at("answer-no").hidden = !isTold;
  put("answer-yes", isTold ? "done" : "send");
  if (state.errors) takeErrors(state.errors);
  showTurn(state.turn);
  showFocus(state.focus);
  at("note").hidden = state.ended;  // nobody takes it then
  const lines = state.events.join("\n");
  if (at("events").dataset.lines !== lines) {
    at("events").dataset.lines = lines;
    at("events").replaceChildren(...state.events.map((line) => Object.assign(document.createElement("li"), {textContent: line})));
  }
  at("housekeeping").hidden = !state.items.length;
  at("items").replaceChildren(...state.items.map(([name, text, colour]) => {
    const item = Object.assign(document.createElement("div"), {className: colour});
    item.append(Object.assign(document.createElement("dt"), {textContent: name}), Object.assign(document.createElement("dd"), {textContent: text}));
    return item;
  }));
  put("session", `${state.sensor}, ${state.site}, ${state.port}; for ${state.duration_s < 120 ? `${state.duration_s} s` : duration(Math.floor(state.duration_s / 60))}; ${state.utc.slice(11, 19)} UTC`);
}


// The errors over time. The server sends bins of mean, spread and extremes; here they become a running mean with its
// band of one standard deviation. The axis follows the data: a limit that is far is a mark at its edge.
const CLOSE_S = 600, LEAST_S = 60, SMOOTH_S = 20, ASK_MS = 1000, LEAST_SHARE = 0.04, GAP = 3.5, MOST_GAP_S = 10;
const GROUP = ["MEAN", "SIGMA", "LOW", "HIGH"].length;
const errors = {view: "sky", subject: "onboard", sends_own: false, axes: [], close: null, whole: null, marks: []};
let plots = [], askedMs = -Infinity;

function request() {
  const nowMs = performance.now();
  if (nowMs - askedMs < ASK_MS && !latest?.ended) return "next";
  askedMs = nowMs;
  const last = (level) => level?.bins.length ? level.bins.at(-1)[0] : 0;
  const mark = errors.marks.length ? errors.marks.at(-1)[0] : 0;
  return `next ${errors.view} ${errors.subject} ${last(errors.close)} ${errors.whole?.step_s ?? 0} ${last(errors.whole)} ${mark}`;
}

function choose(view, subject) {
  Object.assign(errors, {view, subject, axes: [], close: null, whole: null, marks: []});
  for (const node of document.querySelectorAll("#plot-bar button"))
    node.setAttribute("aria-pressed", String(node.dataset.view === view || node.dataset.subject === subject));
  askedMs = -Infinity;
}

function joined(level, news) {
  const kept = !level || news.anew ? [] : level.bins.filter((bin) => bin[0] < news.bins[0]?.[0]);
  return {step_s: news.step_s, bins: [...kept, ...news.bins]};
}

function takeErrors(news) {
  if (news.view !== errors.view) return;  // of a button before
  errors.close = joined(errors.close, news.close);
  const until = errors.close.bins.at(-1)?.[0] ?? 0;
  errors.close.bins = errors.close.bins.filter((bin) => bin[0] > until - CLOSE_S);
  errors.whole = joined(errors.whole, news.whole);
  errors.marks.push(...news.marks);
  errors.axes = news.axes;
  at("subjects").hidden = !news.sends_own || news.view === "across";
  if (plots.length !== news.axes.length || plots.some((plot, k) => plot.name !== news.axes[k].name)) buildPlots();
  plots.forEach((plot, k) => plot.draw(k));
}

// Times, extremes, band and running mean of one axis; a gap where nothing was compared for long.
function curves(level, place, smooth_s) {
  const {step_s, bins} = level, offset = 2 + GROUP * place, data = [[], [], [], [], [], []];
  const gap = Math.max(GAP * step_s * Math.max(1, (bins.at(-1)?.[0] - bins[0]?.[0]) / Math.max(bins.length - 1, 1)), MOST_GAP_S);
  let first = 0, count = 0, sum = 0, squares = 0;
  const add = (bin, sign) => {
    const n = sign * bin[1], mean = bin[offset], sigma = bin[offset + 1];
    count += n; sum += n * mean; squares += n * (mean * mean + sigma * sigma);
  };
  bins.forEach((bin, k) => {
    const time = (bin[0] + 0.5) * step_s;
    if (k && (bin[0] - bins[k - 1][0]) * step_s > gap) {
      [(bins[k - 1][0] + 1) * step_s, null, null, null, null, null].forEach((value, c) => data[c].push(value));
      for (; first < k; first++) add(bins[first], -1);
    }
    add(bin, 1);
    for (; (bin[0] - bins[first][0]) * step_s >= smooth_s && first < k; first++) add(bins[first], -1);
    const mean = sum / count, sigma = Math.sqrt(Math.max(0, squares / count - mean * mean));
    [time, bin[offset + 2], bin[offset + 3], mean - sigma, mean + sigma, mean].forEach((value, c) => data[c].push(value));
  });
  return data;
}

// Zero, the band, and nearly all of the extremes; a limit that is not far, too.
function reach(data, limit) {
  const values = [...data[3], ...data[4]].filter((value) => value !== null);
  const quantile = (list, share) => list.length ? list.sort((a, b) => a - b)[Math.floor(share * (list.length - 1))] : 0;
  const lows = data[1].filter((value) => value !== null), highs = data[2].filter((value) => value !== null);
  let low = Math.min(0, quantile(lows, 0.02), ...values), high = Math.max(0, quantile(highs, 0.98), ...values);
  const least = LEAST_SHARE * (limit ?? 0) || 1;
  if (high - low < least) { low -= least / 2; high += least / 2; }
  const room = 0.12 * (high - low);
  low -= room; high += room;
  if (limit) {
    if (high > 0.7 * limit && high < 1.05 * limit) high = 1.05 * limit;
    if (low < -0.7 * limit && low > -1.05 * limit) low = -1.05 * limit;
  }
  return [low, high];
}

const rem = () => parseFloat(getComputedStyle(document.documentElement).fontSize);
const colour = (name) => getComputedStyle(document.documentElement).getPropertyValue(name).trim();

function behind(u, limit) {
  const {ctx} = u, {left, top, width, height} = u.bbox, ratio = devicePixelRatio;
  const y = (value) => u.valToPos(value, "y", true), x = (time) => u.valToPos(time, "x", true);
  ctx.save();
  ctx.beginPath(); ctx.rect(left, top, width, height); ctx.clip();
  let dark = null;
  const shade = (from, to) => { ctx.fillStyle = colour("--edge"); ctx.fillRect(x(from), top, x(to) - x(from), height); };
  for (const [, time, kind] of errors.marks) {
    if (/^(CLOUDED|NO_STARS|DAYLIGHT)$/.test(kind)) dark ??= time;
    if (/^(CLEAR|DARK_NIGHT)$/.test(kind) && dark !== null) { shade(dark, time); dark = null; }
  }
  if (dark !== null) shade(dark, u.scales.x.max);
  const across = (value, style, dash) => {
    ctx.strokeStyle = style; ctx.lineWidth = ratio; ctx.setLineDash(dash);
    ctx.beginPath(); ctx.moveTo(left, y(value)); ctx.lineTo(left + width, y(value)); ctx.stroke();
  };
  across(0, colour("--dim"), []);
  if (limit) for (const side of [limit, -limit]) across(side, colour("--limit"), [6 * ratio, 4 * ratio]);
  ctx.restore();
}

function before(u, limit, isClose) {
  const {ctx} = u, {left, top, width, height} = u.bbox, ratio = devicePixelRatio, {min, max} = u.scales.y;
  ctx.save();
  ctx.font = `${Math.round(rem() * 0.68 * ratio)}px system-ui, sans-serif`;
  ctx.textAlign = "right";
  if (limit) {
    ctx.fillStyle = colour("--limit");
    if (max < limit) { ctx.textBaseline = "top"; ctx.fillText(`\u25B2 limit +${limit}`, left + width - 4 * ratio, top + (isClose ? 16 : 2) * ratio); }
    if (min > -limit) { ctx.textBaseline = "bottom"; ctx.fillText(`\u25BC limit \u2212${limit}`, left + width - 4 * ratio, top + height - 2 * ratio); }
  }
  ctx.beginPath(); ctx.rect(left, top, width, height); ctx.clip();
  ctx.textAlign = "left"; ctx.textBaseline = "top"; ctx.lineWidth = ratio; ctx.setLineDash([2 * ratio, 3 * ratio]);
  let free = -Infinity;
  for (const [, time, kind, text] of errors.marks) {
    const place = u.valToPos(time, "x", true);
    if (place < left || place > left + width) continue;
    ctx.strokeStyle = ctx.fillStyle = kind === "NOTE" ? colour("--text") : colour("--warn");
    ctx.beginPath(); ctx.moveTo(place, top); ctx.lineTo(place, top + height); ctx.stroke();
    const label = (kind === "NOTE" ? text : kind.toLowerCase().replace("_", " ")).slice(0, 22);
    if (isClose && place > free) { ctx.fillText(label, place + 3 * ratio, top + 2 * ratio); free = place + ctx.measureText(label).width + 9 * ratio; }
  }
  ctx.restore();
}

function clockTimes(u, splits) {
  if (!u.data[0].length) return splits.map(() => "");  // no frame was compared: no time either
  const seconds = splits.length > 1 && splits[1] - splits[0] < 60;
  return splits.map((time) => new Date(time * 1000).toISOString().slice(11, seconds ? 19 : 16));
}

function newPlot(node, isClose, limit) {
  const size = () => ({width: Math.max(node.clientWidth, 60), height: Math.max(node.clientHeight, 40)});
  const line = colour("--line"), dim = colour("--dim"), font = `${Math.round(rem() * 0.7)}px system-ui, sans-serif`;
  const none = {stroke: null, width: 0, points: {show: false}}, shown = (alpha) => `${line}${alpha}`;
  const axis = {font, stroke: dim, grid: {stroke: colour("--edge"), width: 1}, ticks: {show: false}};
  const plot = new uPlot({
    ...size(), padding: [4, Math.round(1.6 * rem()), 0, 0], legend: {show: false}, cursor: {y: false, points: {show: false}, drag: {x: false, y: false}},
    tzDate: (seconds) => uPlot.tzDate(new Date(seconds * 1000), "Etc/UTC"),
    scales: {x: {time: true, range: (u, low, high) => [isClose ? Math.max(low, high - CLOSE_S) : low, Math.max(high, low + LEAST_S)]},
      y: {range: (u) => reach(u.data, limit)}},
    series: [{}, none, none, none, none, {stroke: line, width: isClose ? 3 : 2, points: {show: false}}],
    bands: [{series: [2, 1], fill: shown("38")}, {series: [4, 3], fill: shown("66")}],
    axes: [{...axis, size: 20, gap: 2, space: 80, values: clockTimes}, {...axis, size: 44, gap: 3, space: isClose ? 24 : 13}],
    hooks: {drawAxes: [(u) => behind(u, limit)], draw: [(u) => before(u, limit, isClose)]},
  }, [[], [], [], [], [], []], node);
  new ResizeObserver(() => plot.setSize(size())).observe(node);
  return plot;
}

function buildPlots() {
  at("axes").replaceChildren();
  plots = errors.axes.map(({name, limit_arcsec: limit}, k) => {
    const box = Object.assign(document.createElement("div"), {id: `axis-${k}`, className: "axis"});
    box.innerHTML = '<div class="figures"><h2></h2> <span class="value"></span> <small></small></div><div class="close"></div><div class="whole"></div>';
    at("axes").append(box);
    box.querySelector("h2").textContent = `${name} (arcsec)`;
    const close = newPlot(box.querySelector(".close"), true, limit), whole = newPlot(box.querySelector(".whole"), false, limit);
    return {name, close, whole, draw(place) {
      const span_s = (errors.whole.bins.at(-1)?.[0] - errors.whole.bins[0]?.[0]) * errors.whole.step_s || 0;
      close.setData(curves(errors.close, place, SMOOTH_S));
      whole.setData(curves(errors.whole, place, Math.max(SMOOTH_S, span_s / 50)));
      showFigures(box, place, limit);
    }};
  });
}

// Mean and spread of the whole session so far, and the last error.
function showFigures(box, place, limit) {
  const offset = 2 + GROUP * place, axis = latest.axes.find((one) => one.name === errors.axes[place].name && (one.subject === "sensor") === (errors.subject === "own" || !errors.sends_own && one.subject === "sensor"));
  let count = 0, sum = 0, squares = 0;
  for (const bin of errors.whole.bins) {
    count += bin[1]; sum += bin[1] * bin[offset]; squares += bin[1] * (bin[offset] ** 2 + bin[offset + 1] ** 2);
  }
  const mean = count ? sum / count : null, std = count ? Math.sqrt(Math.max(0, squares / count - mean * mean)) : null;
  const last = axis?.last_arcsec ?? errors.close.bins.at(-1)?.[offset] ?? null, value = box.querySelector(".value");
  value.textContent = angle(last, 1);
  value.classList.toggle("stale", !latest.ended && latest.since_answer_s > STALE_AFTER_S);
  value.classList.toggle("outside", Boolean(limit) && Math.abs(last) > limit);
  const small = box.querySelector("small");
  small.textContent = `${axis?.outside ? "OUTSIDE " : ""}mean ${angle(mean, 1)}, std ${number(std, 1)}${axis ? `, NEA ${number(axis.nea_arcsec, 1)}` : ""}${limit ? `, limit ${limit}` : ""}`;
  small.classList.toggle("outside", Boolean(axis?.outside));
}

function showTurn(turn) {
  put("turn", turn ? turn.text : "no answer to compare with a stated mount");
  put("arrow-up", turn ? turn.up : "");
  put("arrow-across", turn ? turn.across.split(" ")[0] : "");
  if (!turn) {
    at("needle").setAttribute("d", "");
    return;
  }
  // The length tells the size by its logarithm: 1 arcsec is at the centre, 10 deg at the rim.
  const size = Math.hypot(turn.across_deg, turn.up_deg);
  const length = 50 * Math.min(1, Math.max(0.06, Math.log10(Math.max(size * 3600, 1)) / Math.log10(36000)));
  const x = size ? turn.across_deg / size : 0, y = size ? -turn.up_deg / size : 0;
  const tip = [x * length, y * length], back = 8;
  const barb = (side) => `L${tip[0] - back * (x * 0.8 - side * y * 0.6)} ${tip[1] - back * (y * 0.8 + side * x * 0.6)}`;
  at("needle").setAttribute("d", `M0 0L${tip[0]} ${tip[1]}${barb(1)}M${tip[0]} ${tip[1]}${barb(-1)}`);
}

function showFocus(focus) {
  if (!focus) return;
  const fwhm = focus.fwhm_px === null ? "width of the stars not sent" : `FWHM ${focus.fwhm_px.toFixed(1)} px`;
  const brightest = focus.objects ? `, brightest ${focus.brightest} of ${focus.index_max}; ${fwhm}` : "";
  put("focus", `${focus.objects} object${focus.objects === 1 ? "" : "s"}${brightest}`);
  put("index-max", String(focus.index_max));
  const most = Math.max(1, ...focus.histogram), step = 120 / focus.histogram.length;
  at("histogram").replaceChildren(...focus.histogram.map((count, place) => svg("rect", {
    x: place * step + 0.5, width: step - 1, y: 60 - 58 * count / most - 1, height: 58 * count / most + 1,
  })));
}

function connect() {
  const socket = new WebSocket(`ws://${location.host}/live`);
  socket.onmessage = (message) => {
    latest = JSON.parse(message.data);
    heardMs = performance.now();
    show(latest);
    socket.send(request());
  };
  socket.onclose = () => {
    if (latest?.ended) {
      put("detail", ["the session has ended", latest.word.detail].filter(Boolean).join(": "));
    } else {
      setTimeout(connect, AGAIN_AFTER_MS);
    }
  };
}

let lookedMs = performance.now();
setInterval(() => {
  // A phone that slept, or a browser that was busy, has messages to show first.
  const nowMs = performance.now();
  if (nowMs - lookedMs > BUSY_MS) heardMs += nowMs - lookedMs - LOOK_MS;
  lookedMs = nowMs;
  const silentMs = performance.now() - heardMs;
  const isLost = silentMs > LOST_AFTER_MS && !latest?.ended;
  document.body.classList.toggle("lost", isLost);
  if (isLost) {
    const last = latest ? `last word: ${latest.word.text} at ${latest.utc.slice(11, 19)} UTC` : "no word from the station yet";
    putWord(`CONNECTION LOST ${Math.floor(silentMs / 1000)} s`, "bad", `${last}; the session may go on or have ended: gse status shows it`);
  }
}, LOOK_MS);

// Themes, kept by the browser and in the address (#red, #large, #red,large).
function applyThemes() {
  for (const theme of ["red", "large"]) {
    const on = themes.has(theme);
    document.documentElement.classList.toggle(theme, on);
    at(`${theme}-theme`).setAttribute("aria-pressed", String(on));
  }
}
const fragment = location.hash.slice(1).split(",").filter(Boolean);
const token = fragment.find((part) => part.startsWith("token="));
const stored = (() => { try { return localStorage.getItem("gse-themes") ?? ""; } catch { return ""; } })();
const asked = fragment.filter((part) => part === "red" || part === "large");
const themes = new Set(asked.length ? asked : stored.split(",").filter(Boolean));
let givenToken = token ? token.slice(6) : "";
function turn(theme) {
  themes.has(theme) ? themes.delete(theme) : themes.add(theme);
  try { localStorage.setItem("gse-themes", [...themes].join(",")); } catch { /* a private window */ }
  history.replaceState(null, "", `#${[...themes].join(",")}`);
  applyThemes();
  fitWord();
  if (errors.whole) { buildPlots(); plots.forEach((plot, k) => plot.draw(k)); }
}
for (const node of document.querySelectorAll("#plot-bar button"))
  node.onclick = () => choose(node.dataset.view ?? errors.view, node.dataset.subject ?? errors.subject);
at("red-theme").onclick = () => turn("red");
at("large-theme").onclick = () => turn("large");
at("tone").onclick = () => {
  audio = audio ? null : new AudioContext();
  put("tone", audio ? "tone: on" : "tone: off");
  at("tone").setAttribute("aria-pressed", String(Boolean(audio)));
};
async function leaveNote(text) {
  const send = () => fetch("note", {method: "POST", body: JSON.stringify({text}),
    headers: {"Content-Type": "application/json", "X-Gse-Token": givenToken}});
  try {
    let answer = await send();
    if (answer.status === 403) {
      givenToken = prompt("The token that gse run printed at the start:") ?? "";
      answer = await send();
    }
    const found = await answer.json();
    put("note-answer", found.error ?? `noted: ${found.note}`);
    return answer.ok;
  } catch (error) {
    put("note-answer", `not sent: ${error}`);
    return false;
  }
}
at("note").onsubmit = async (event) => {
  event.preventDefault();
  const touched = event.submitter && event.submitter.value === "mount";
  if (await leaveNote((touched ? "mount: " : "") + at("note-text").value)) at("note-text").value = "";
};
// With the number of its step: by the time that it comes another one may ask.
async function answer(text) {
  const step = at("question-text").textContent.match(/^step ([0-9.]+):/);
  if (step && await leaveNote(`answer:${step[1]}: ${text}`)) at("answer-text").value = "";
  put("answer-problem", at("note-answer").textContent.startsWith("noted") ? "" : at("note-answer").textContent);
}
at("answer").onsubmit = (event) => { event.preventDefault(); answer(at("answer-text").value); };
at("answer-no").onclick = () => answer("no");
at("alarm-seen").onclick = () => leaveNote(`alarm seen: ${at("alarm-text").textContent}`.slice(0, 280));
addEventListener("resize", fitWord);
applyThemes();
connect();
