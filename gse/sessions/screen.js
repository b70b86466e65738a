"use strict";
// Draws the stars of a scene, pixel by pixel, at the instants that the station plans.
//
// A star is a Gaussian spot in linear light, integrated where it stands between pixels; each pixel's light is added up
// and goes through the panel's brightness law (gamma) once. So a spot's centre of light stands at its sub-pixel place.
// The browser's clock is compared with the station's by questions: the quickest answer is the best one, half of its
// way is the uncertainty. For a scene that turns, a picture shows the attitude of the middle of its time on the panel.
const canvas = document.getElementById("sky"), paint = canvas.getContext("2d", { alpha: false, desynchronized: true });
const say = document.getElementById("say");
const REPORT_MS = 500, AGAIN_MS = 1000, FORGET_MS = 600000, REACH = 4.5;
let sky = null, scene = null, planned = [], picture = null, pixels = null, light = null, touched = [];
let socket = null, clock = { offset: 0, trip: Infinity, at: 0 }, drawn = -1, turnedAt = null, gap = 0;

function connect() {
  socket = new WebSocket(`ws://${location.host}/screen/live`);
  socket.onopen = () => { clock.trip = Infinity; report(); };
  socket.onmessage = (event) => hear(JSON.parse(event.data));
  socket.onclose = (event) => {
    say.textContent = event.reason || "the station has ended";
    setTimeout(connect, AGAIN_MS);
  };
}

function hear(told) {
  if (told.asked !== undefined) compare(told);
  if (told.sky) take(told.sky);
  if (told.scenes) planned.push(...told.scenes);
}

function compare({ asked, now_ms }) {
  const now = performance.now(), trip = now - asked;
  if (trip > clock.trip && now - clock.at < FORGET_MS) return;
  clock = { offset: now_ms - (asked + now) / 2, trip, at: now };
}

function report() {
  if (socket.readyState !== WebSocket.OPEN) return;
  const ratio = window.devicePixelRatio;
  socket.send(JSON.stringify({
    asked: performance.now(),
    width: Math.round(innerWidth * ratio), height: Math.round(innerHeight * ratio), ratio,
    visible: document.visibilityState === "visible",
    round_trip_ms: Number.isFinite(clock.trip) ? clock.trip : null,
    gap_ms: gap,
  }));
  gap = 0;
}

function take(document) {
  sky = document;
  canvas.width = sky.columns; canvas.height = sky.rows;
  const ratio = window.devicePixelRatio;
  canvas.style.width = `${sky.columns / ratio}px`; canvas.style.height = `${sky.rows / ratio}px`;
  picture = paint.createImageData(sky.columns, sky.rows);
  pixels = new Uint32Array(picture.data.buffer).fill(0xff000000);
  light = new Float32Array(sky.columns * sky.rows);
  sky.disc = new Map(sky.discs);
  sky.levels = levels();
  paint.putImageData(picture, 0, 0);
  drawn = -1; planned = []; scene = null;
}

// The inverse of the panel's law: which of its 256 levels gives so much light. By the root of the light, of which the
// faintest level has 60 steps: a power for each pixel takes longer than all else.
const STEPS = 65535;

function levels() {
  return Uint8Array.from({ length: STEPS + 1 }, (_, k) => Math.round(255 * Math.pow(k / STEPS, 2 / sky.gamma)));
}

function level(linear) {
  return linear >= 1 ? 255 : sky.levels[Math.round(STEPS * Math.sqrt(linear))];
}

function add(x, y, brightness, size) {
  const reach = Math.ceil(REACH * sky.spot_px + size / 2), s = 1 / (Math.SQRT2 * sky.spot_px);
  const left = Math.max(Math.round(x) - reach, 0), right = Math.min(Math.round(x) + reach, sky.columns - 1);
  const top = Math.max(Math.round(y) - reach, 0), bottom = Math.min(Math.round(y) + reach, sky.rows - 1);
  if (left > right || top > bottom) return;
  // A Gaussian is a product of one along the columns and one along the rows; a disc is none.
  const along = new Float64Array(right - left + 1);
  for (let k = 0; k < along.length; k += 1) along[k] = Math.exp(-(((left + k - x) * s) ** 2));
  for (let row = top; row <= bottom; row += 1) {
    const at = row * sky.columns, down = size ? 0 : brightness * Math.exp(-(((row - y) * s) ** 2));
    for (let column = left; column <= right; column += 1) {
      const beyond = size ? Math.max(Math.hypot(row - y, column - x) - size / 2, 0) * s : 0;
      light[at + column] += size ? brightness * Math.exp(-beyond * beyond) : down * along[column - left];
    }
  }
  touched.push([left, top, right, bottom]);
}

// Where directions of the screen's axes fall on its pixels: the camera model of the station, from ideal to panel.
function place(u, v) {
  const half = sky.columns / 2, [k1, k2] = sky.radial, [p1, p2] = sky.tangential;
  const wantX = u * sky.focal_px / half, wantY = v * sky.focal_px / half;
  let x = wantX, y = wantY;
  for (let turn = 0; turn < 50 && (k1 || k2 || p1 || p2); turn += 1) {
    const s2 = x * x + y * y, radial = 1 + s2 * (k1 + s2 * k2);
    const offX = x * radial + 2 * p1 * x * y + p2 * (s2 + 2 * x * x) - wantX;
    const offY = y * radial + p1 * (s2 + 2 * y * y) + 2 * p2 * x * y - wantY;
    const slope = 2 * k1 + 4 * s2 * k2;
    const xx = radial + x * x * slope + 2 * p1 * y + 6 * p2 * x, yy = radial + y * y * slope + 6 * p1 * y + 2 * p2 * x;
    const xy = x * y * slope + 2 * p1 * x + 2 * p2 * y, det = xx * yy - xy * xy;
    const stepX = (yy * offX - xy * offY) / det, stepY = (xx * offY - xy * offX) / det;
    x -= stepX; y -= stepY;
    if (Math.abs(stepX) + Math.abs(stepY) < 1e-12) break;
  }
  return [x * half + (sky.columns - 1) / 2, y * half + (sky.rows - 1) / 2];
}

function turned(axes, turn, seconds) {
  const rate = Math.hypot(...turn), angle = rate * seconds;
  if (!angle) return axes;
  const [x, y, z] = turn.map((part) => part / rate), c = Math.cos(angle), s = Math.sin(angle), d = 1 - c;
  // The inverse of the rotation about the sensor's own axis: what it sees goes the other way.
  const inverse = [
    [c + x * x * d, x * y * d + z * s, x * z * d - y * s],
    [y * x * d - z * s, c + y * y * d, y * z * d + x * s],
    [z * x * d + y * s, z * y * d - x * s, c + z * z * d],
  ];
  return inverse.map((row) => [0, 1, 2].map((k) => row[0] * axes[0][k] + row[1] * axes[1][k] + row[2] * axes[2][k]));
}

function draw(seconds) {
  const before = touched;
  for (const [left, top, right, bottom] of before) {
    for (let row = top; row <= bottom; row += 1) {
      const at = row * sky.columns;
      light.fill(0, at + left, at + right + 1);
      pixels.fill(0xff000000, at + left, at + right + 1);
    }
  }
  touched = [];
  const [right, down, out] = turned(scene.axes, scene.turn_rad_per_s, seconds), stars = sky.stars;
  const reachX = sky.columns / sky.focal_px, reachY = sky.rows / sky.focal_px;
  for (let k = 0; k < stars.length; k += 4) {
    const z = out[0] * stars[k] + out[1] * stars[k + 1] + out[2] * stars[k + 2];
    if (z <= 0.1) continue;
    const u = (right[0] * stars[k] + right[1] * stars[k + 1] + right[2] * stars[k + 2]) / z;
    const v = (down[0] * stars[k] + down[1] * stars[k + 1] + down[2] * stars[k + 2]) / z;
    if (Math.abs(u) > reachX || Math.abs(v) > reachY) continue;
    const [x, y] = place(u, v);
    add(x, y, Math.min(Math.pow(10, -0.4 * (stars[k + 3] - sky.brightest)), 1), sky.disc.get(k / 4) || 0);
  }
  for (const [x, y, magnitude] of scene.spots) add(x, y, Math.pow(10, -0.4 * (magnitude - sky.brightest)), 0);
  for (const [left, top, right_, bottom] of touched) {
    for (let row = top; row <= bottom; row += 1) {
      for (let at = row * sky.columns + left, end = row * sky.columns + right_; at <= end; at += 1) {
        if (light[at]) pixels[at] = 0xff000000 | (level(light[at]) * 0x010101);
      }
    }
  }
  for (const [left, top, right_, bottom] of [...before, ...touched]) {
    paint.putImageData(picture, 0, 0, left, top, right_ - left + 1, bottom - top + 1);
  }
}

function frame(now) {
  requestAnimationFrame(frame);
  const stationMs = now + clock.offset;
  if (!sky) return;
  while (planned.length && stationMs + 500 / sky.refresh_hz >= planned[0].from_ms) scene = planned.shift();
  if (!scene) return;
  const isNew = scene.step !== drawn;
  const turns = scene.turn_rad_per_s.some(Boolean);
  if (!isNew && !turns) return;
  // While a scene turns, a picture that stands longer than its time shows an attitude that is over.
  if (!isNew && turnedAt !== null) gap = Math.max(gap, now - turnedAt);
  turnedAt = turns ? now : null;
  say.textContent = "";
  draw(Math.max((stationMs - scene.from_ms) / 1000 + 0.5 / sky.refresh_hz, 0));
  if (isNew) {
    drawn = scene.step;
    socket.send(JSON.stringify({ drawn: scene.step, late_ms: stationMs - scene.from_ms }));
  }
}

addEventListener("resize", report);
document.addEventListener("visibilitychange", report);
document.addEventListener("click", () => document.documentElement.requestFullscreen());
setInterval(report, REPORT_MS);
connect();
requestAnimationFrame(frame);
