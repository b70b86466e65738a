"use strict";
// Shows the documents of a running session. The next one is asked for after the last one is shown, so that a slow
// browser gets fewer of them and never stays behind.
const LOST_AFTER_MS = 2000;
const AGAIN_AFTER_MS = 1000;
const LOOK_MS = 500, BUSY_MS = 1500;
const STALE_AFTER_S = 2, LONG_S = 600;
const EDGE = 1.45, MARK = 0.3;
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
  const isStale = !state.ended && state.since_answer_s > STALE_AFTER_S;
  state.axes.forEach((axis, place) => showAxis(axis, place, isStale));
  showTurn(state.turn);
  showFocus(state.focus);
  at("note").hidden = state.ended;  // nobody takes it then
  const lines = state.events.join("\n");
  if (at("events").dataset.lines !== lines) {
    at("events").dataset.lines = lines;
    at("events").replaceChildren(...state.events.map((line) => Object.assign(document.createElement("li"), {textContent: line})));
  }
  put("session", `${state.sensor}, ${state.site}, ${state.port}; for ${state.duration_s < 120 ? `${state.duration_s} s` : duration(Math.floor(state.duration_s / 60))}; ${state.utc.slice(11, 19)} UTC`);
}

function showAxis(axis, place, isStale) {
  const id = `axis-${place}`;
  if (!at(id)) {
    const box = Object.assign(document.createElement("div"), {id, className: "axis"});
    box.innerHTML = '<h2></h2><span class="value"></span> <small></small>' +
      '<svg viewBox="0 -1.5 120 3" preserveAspectRatio="none"><path class="zero" d="M0 0H120"/>' +
      '<path class="limit" d="M0-1H120M0 1H120"/><path class="spark"/></svg>' +
      '<div class="scale"><span>10 min ago</span><span class="bounds"></span><span>now</span></div>';
    at("axes").append(box);
  }
  const box = at(id);
  box.querySelector("h2").textContent = `${axis.name}, ${axis.subject} (arcsec)`;
  const value = box.querySelector(".value");
  value.textContent = angle(axis.last_arcsec, 1);
  value.classList.toggle("stale", isStale);
  value.classList.toggle("outside", Math.abs(axis.last_arcsec) > axis.limit_arcsec);
  box.querySelector("small").textContent =
    (axis.outside ? "OUTSIDE " : "") +
    `mean ${angle(axis.mean_arcsec, 1)}, std ${number(axis.std_arcsec, 1)}, NEA ${number(axis.nea_arcsec, 1)}`;
  box.querySelector(".bounds").textContent = `dashed: limits ±${axis.limit_arcsec}`;
  const recent = axis.recent ?? [];
  const line = recent.map((pair, x) => pair ? `M${x + 0.5} ${bar(pair).join("V")}` : "");
  box.querySelector(".spark").setAttribute("d", line.join(""));
}

// From top to bottom of the errors of some seconds, in limits downwards; far ones are a mark at the edge.
function bar([low, high]) {
  const top = -Math.min(EDGE, high), bottom = -Math.max(-EDGE, low);
  if (low > EDGE - MARK) return [top, top + MARK];
  return high < MARK - EDGE ? [bottom - MARK, bottom] : [top, bottom + 0.02];
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
    socket.send("next");
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
}
at("red-theme").onclick = () => turn("red");
at("large-theme").onclick = () => turn("large");
at("tone").onclick = () => {
  audio = audio ? null : new AudioContext();
  put("tone", audio ? "tone: on" : "tone: off");
  at("tone").setAttribute("aria-pressed", String(Boolean(audio)));
};
at("note").onsubmit = async (event) => {
  event.preventDefault();
  const text = at("note-text").value;
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
    if (answer.ok) at("note-text").value = "";
  } catch (error) {
    put("note-answer", `not sent: ${error}`);
  }
};
addEventListener("resize", fitWord);
applyThemes();
connect();
