// Mouse, touch and keys on the picture.

const TURN_DEG = 0.35;   // a pixel of a drag
const KEY_DEG = 5;
const CLOSER = 1.1;

export class Tools {
  constructor(picture, send, actions) {
    Object.assign(this, {picture, send, actions, tool: "camera", drag: null, turned: [0, 0], moved: [0, 0], factor: 1});
    const {canvas} = picture;
    canvas.onpointerdown = event => this.down(event);
    canvas.onpointermove = event => this.move(event);
    canvas.onpointerup = canvas.onpointercancel = event => this.up(event);
    canvas.oncontextmenu = event => event.preventDefault();
    canvas.addEventListener("wheel", event => this.wheel(event), {passive: false});
    canvas.ondblclick = () => { if (this.tool === "picture") picture.fit(); };
    addEventListener("keydown", event => this.key(event));
    for (const button of document.querySelectorAll("[data-tool]")) button.onclick = () => this.choose(button.dataset.tool);
  }

  choose(tool) {
    this.tool = this.picture.canvas.dataset.tool = tool;
    for (const button of document.querySelectorAll("[data-tool]")) button.setAttribute("aria-pressed", button.dataset.tool === tool);
  }

  nearWipe(event) {
    if (!this.picture.split) return false;
    const [x] = this.picture.at(event), cut = this.picture.wipe * this.picture.full[0];
    return Math.abs(x - cut) * this.picture.place().scale < 8 * devicePixelRatio;
  }

  down(event) {
    const {picture} = this;
    picture.canvas.setPointerCapture(event.pointerId);
    picture.canvas.focus({preventScroll: true});
    picture.canvas.classList.add("dragging");
    const kind = this.nearWipe(event) ? "wipe" : event.button === 1 ? "picture"
      : this.tool === "camera" && (event.shiftKey || event.button === 2) ? "shift" : this.tool;
    this.drag = {kind, x: event.clientX, y: event.clientY, start: picture.at(event)};
  }

  move(event) {
    const {picture, drag} = this;
    this.actions.pointer(picture.at(event));
    if (!drag) { picture.canvas.classList.toggle("wipe", this.nearWipe(event)); return; }
    const dx = event.clientX - drag.x, dy = event.clientY - drag.y;
    [drag.x, drag.y] = [event.clientX, event.clientY];
    if (drag.kind === "camera") this.turn(-TURN_DEG * dx, TURN_DEG * dy);
    else if (drag.kind === "shift") {
      const height = picture.full[1] * picture.place().scale / devicePixelRatio;
      this.shift(-dx / height, dy / height);
    } else if (drag.kind === "picture") picture.move(dx, dy);
    else if (drag.kind === "wipe") { picture.wipe = Math.min(Math.max(picture.at(event)[0] / picture.full[0], 0), 1); picture.redraw(); }
    else { picture.region = this.box(drag.start, picture.at(event)); picture.redraw(); }
  }

  up(event) {
    const {picture, drag} = this;
    this.drag = null;
    picture.canvas.classList.remove("dragging");
    if (!drag || drag.kind !== "region") return;
    const box = this.box(drag.start, picture.at(event));
    picture.region = null;
    picture.redraw();
    if (box[2] - box[0] >= 4 && box[3] - box[1] >= 4) this.send({do: "crop", box});
  }

  box([x, y], [u, v]) {
    const [w, h] = this.picture.full, within = (value, most) => Math.min(Math.max(Math.round(value), 0), most);
    return [within(Math.min(x, u), w), within(Math.min(y, v), h), within(Math.max(x, u), w), within(Math.max(y, v), h)];
  }

  wheel(event) {
    event.preventDefault();
    const factor = Math.exp(-0.0015 * event.deltaY * (event.deltaMode ? 16 : 1));
    if (this.tool === "camera" && !event.ctrlKey) this.closer(1 / factor);
    else this.picture.zoom(factor, event);
  }

  // What was done since the last frame is sent together.
  turn(azimuth, elevation) { this.turned[0] += azimuth; this.turned[1] += elevation; this.later(); }
  shift(right, up) { this.moved[0] += right; this.moved[1] += up; this.later(); }
  closer(factor) { this.factor *= factor; this.later(); }

  later() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => {
      this.waiting = false;
      const [azimuth, elevation] = this.turned, [right, up] = this.moved, {factor} = this;
      if (azimuth || elevation) this.send({do: "orbit", azimuth_deg: azimuth, elevation_deg: elevation});
      if (right || up) this.send({do: "move", right, up});
      if (factor !== 1) this.send({do: "dolly", factor: Math.min(Math.max(factor, 0.05), 20)});
      [this.turned, this.moved, this.factor] = [[0, 0], [0, 0], 1];
    });
  }

  key(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const {picture, actions} = this, target = event.target;
    if (target.matches("input, select, textarea")) return;
    const arrows = {ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1]}[event.key];
    if (arrows && (target === picture.canvas || target === document.body)) {
      const [x, y] = arrows;
      if (this.tool === "picture") picture.move(-40 * x, 40 * y);
      else if (event.shiftKey) this.shift(0.05 * x, 0.05 * y);
      else this.turn(KEY_DEG * x, KEY_DEG * y);
      event.preventDefault();
      return;
    }
    const done = {
      c: () => this.choose("camera"), p: () => this.choose("picture"), r: () => this.choose("region"),
      a: () => actions.slot("A"), b: () => actions.slot("B"), s: actions.split,
      "+": () => this.nearer(CLOSER), "=": () => this.nearer(CLOSER), "-": () => this.nearer(1 / CLOSER),
      "[": () => actions.exposure(-0.25), "]": () => actions.exposure(0.25),
      0: () => picture.fit(), 1: () => picture.oneToOne(),
      " ": target.matches("button, a, summary") ? null : actions.pause,
      Escape: () => { picture.region = this.drag = null; picture.redraw(); },
    }[event.key.length === 1 ? event.key.toLowerCase() : event.key];
    if (done) { done(); event.preventDefault(); }
  }

  nearer(factor) { if (this.tool === "picture") this.picture.zoom(factor); else this.closer(1 / factor); }
}
