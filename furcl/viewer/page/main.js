// The page: what the server tells is shown, what is asked for is sent.

import {drawLobes} from "./lobes.js";
import {Panel, short} from "./panel.js";
import {Picture} from "./picture.js";
import {Tools} from "./tools.js";

const byId = id => document.getElementById(id);
let socket = null, state = null, lobes = {}, waiting = {}, ended = false, hiding = 0;

const picture = new Picture(byId("canvas"), zoom => { byId("zoom").value = `${Math.round(100 * zoom)} %`; });
const panel = new Panel(sendLater);
const tools = new Tools(picture, send, {
  slot: choose, split: toggleSplit, exposure: by => expose(picture.stops + by, true),
  pause: () => send({do: "pause", on: !state?.paused}), pointer: showPixel,
});

function send(message) {
  if (socket?.readyState === WebSocket.OPEN) socket.send(JSON.stringify(message));
}

// Of a slider only the last value within a frame is sent.
function sendLater(message) {
  if (message.do !== "set") { send(message); return; }
  if (!Object.keys(waiting).length) requestAnimationFrame(() => {
    Object.values(waiting).forEach(send);
    waiting = {};
  });
  waiting[message.key] = message;
}

function connect() {
  const here = new URL("socket", location.href);
  here.protocol = "ws:";
  socket = new WebSocket(here);
  socket.binaryType = "arraybuffer";
  socket.onmessage = ({data}) => {
    if (typeof data !== "string") { showPicture(picture.take(data)); return; }
    const message = JSON.parse(data);
    ({state: showState, lobes: showLobes, error: showError})[message.type]?.(message);
  };
  socket.onclose = () => {
    byId("doing").textContent = "not connected";
    if (!ended) say("furcl does not answer: it has ended, or is about to. Start furcl view again for a new page.", true);
    setTimeout(connect, 3000);
  };
  socket.onopen = () => { if (!ended) hideMessage(); };
}

function showState(message) {
  const first = state === null;
  state = message;
  document.title = `${state.scene} – furcl`;
  byId("scene").textContent = state.scene;
  byId("device").textContent = byId("device").title = state.device;
  byId("pause").textContent = state.paused ? "Go on" : "Pause";
  picture.shown = state.slot;
  for (const button of document.querySelectorAll("[data-slot]")) {
    button.setAttribute("aria-pressed", button.dataset.slot === state.slot);
  }
  byId("copy").textContent = state.slot === "A" ? "Copy A to B" : "Copy B to A";
  byId("copy").disabled = state.same;
  byId("whole").hidden = state.crop === null;
  if (first) expose(state.exposure_stops);
  for (const [id, value] of [["width", state.size[0]], ["height", state.size[1]], ["spp", state.spp]]) {
    if (document.activeElement !== byId(id)) byId(id).value = value;
  }
  if (state.camera) {
    byId("azimuth").textContent = `${state.camera.azimuth_deg.toFixed(1)}°`;
    byId("elevation").textContent = `${state.camera.elevation_deg.toFixed(1)}°`;
    byId("distance").textContent = short(state.camera.distance);
  }
  byId("reset-camera").disabled = !state.moved;
  if (state.doing) byId("doing").textContent = state.doing;
  else if (state.paused) byId("doing").textContent = "paused";
  else if (byId("doing").textContent === "paused") byId("doing").textContent = "rendering";
  panel.show(state);
  byId("draft").hidden = !state.drafted?.includes(panel.material?.name);
  byId("changed").replaceChildren(...state.changed.map(key => {
    const item = document.createElement("li"), button = document.createElement("button");
    item.textContent = key;
    button.textContent = "reset";
    button.setAttribute("aria-label", `reset ${key}`);
    button.onclick = () => send({do: "reset", key});
    item.append(button);
    return item;
  }));
  redrawLobes();
  picture.redraw();
}

function showPicture(facts) {
  if (facts.slot !== state?.slot) return;
  const done = !facts.coarse && facts.samples >= facts.spp;
  if (!state.paused) byId("doing").textContent = done ? "done" : "rendering";
  byId("samples").textContent = `${facts.samples} of ${facts.spp} samples`;
  byId("noise").textContent = facts.noise === null ? "" : `noise ${(100 * facts.noise).toPrecision(2)} %`;
  byId("left").textContent = done || facts.left_s === null ? "" : `${time(facts.left_s)} left`;
  byId("progress").firstElementChild.style.width = `${100 * facts.samples / facts.spp}%`;
}

const time = s => s < 90 ? `${Math.ceil(s)} s` : s < 5400 ? `${Math.round(s / 60)} min` : `${(s / 3600).toFixed(1)} h`;

function showPixel([x, y]) {
  const value = picture.value(x, y);
  byId("pixel").textContent = value && Number.isFinite(value[0])
    ? `${Math.floor(x)}, ${Math.floor(y)}   ${value.map(v => v.toPrecision(3)).join("  ")}` : "";
}

function showLobes(message) { lobes[message.material] = message; redrawLobes(); }

function redrawLobes() {
  const found = panel.material && lobes[panel.material.name];
  if (found) drawLobes(found);
}

function showError(message) {
  if (message.fatal) { ended = true; byId("doing").textContent = "ended"; }
  say(message.text, message.fatal);
}

function say(text, stays) {
  byId("message").textContent = text;
  byId("message").hidden = false;
  clearTimeout(hiding);
  if (!stays) hiding = setTimeout(hideMessage, 10000);
}

function hideMessage() { byId("message").hidden = true; }

// The scene is told when the slider rests, the picture is toned at once.
function expose(stops, tell) {
  stops = Math.round(1000 * Math.min(Math.max(stops, -20), 20)) / 1000;
  picture.setStops(stops);
  byId("exposure").value = byId("exposure-number").value = stops;
  if (tell) send({do: "set", key: "film.exposure_stops", value: stops});
}

function choose(slot) {
  if (picture.split) toggleSplit();
  send({do: "slot", slot});
}

function toggleSplit() {
  picture.split = !picture.split;
  byId("split").setAttribute("aria-pressed", picture.split);
  if (picture.split && !picture.slots.B) send({do: "copy"});
  picture.redraw();
}

byId("message").onclick = hideMessage;
byId("split").onclick = toggleSplit;
byId("copy").onclick = () => send({do: "copy"});
byId("fit").onclick = () => picture.fit();
byId("whole").onclick = () => send({do: "crop", box: null});
byId("pause").onclick = () => send({do: "pause", on: !state?.paused});
byId("reset-camera").onclick = () => send({do: "reset-camera"});
byId("exposure").oninput = event => expose(Number(event.target.value));
byId("exposure").onchange = event => expose(Number(event.target.value), true);
byId("exposure-number").onchange = event => expose(Number(event.target.value), true);
for (const [id, key] of [["width", "film.width"], ["height", "film.height"], ["spp", "render.spp"]]) {
  byId(id).onchange = event => send({do: "set", key, value: Math.round(Number(event.target.value))});
}
for (const button of document.querySelectorAll("[data-slot]")) button.onclick = () => choose(button.dataset.slot);
byId("set").onsubmit = event => {
  event.preventDefault();
  const [key, ...value] = byId("set-text").value.split("=");
  if (!value.length) { say("Give a key and a value, as in render.max_depth = 8"); return; }
  send({do: "set", key: key.trim(), value: value.join("=").trim()});
};
addEventListener("resize", redrawLobes);
connect();
