// The canvas: pictures of both settings, toned here, enlarged and moved.

const VALUES = new Float32Array(1 << 16);  // of all float16
for (let bits = 0; bits < 1 << 16; bits++) {
  const exponent = (bits >> 10) & 31, fraction = bits & 1023;
  const size = exponent === 0 ? fraction * 2 ** -24
    : exponent === 31 ? (fraction ? NaN : Infinity)
    : (1 + fraction / 1024) * 2 ** (exponent - 15);
  VALUES[bits] = bits & 0x8000 ? -size : size;
}

const encode = x => x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;  // sRGB

export class Picture {
  constructor(canvas, onZoom) {
    this.canvas = canvas;
    this.context = canvas.getContext("2d");
    this.slots = {};           // A, B: {full, coarse, fine, layer}
    this.shown = "A";
    this.split = false;
    this.wipe = 0.5;           // where A ends, of the picture's width
    this.stops = 0;
    this.tones = new Uint8ClampedArray(1 << 16);
    this.scale = null;         // screen pixels a pixel; null: fitted in
    this.offset = [0, 0];
    this.region = null;        // being chosen
    this.onZoom = onZoom;
    this.waiting = false;
    this.setStops(0);
    new ResizeObserver(() => this.redraw()).observe(canvas);
  }

  setStops(stops) {
    this.stops = stops;
    const factor = 2 ** stops;
    for (let bits = 0; bits < 1 << 16; bits++) {
      const value = VALUES[bits] * factor;
      this.tones[bits] = value > 0 ? Math.round(255 * encode(Math.min(value, 1))) : 0;
    }
    for (const slot of Object.values(this.slots)) this.paint(slot);
    this.redraw();
  }

  // A message of the server: length, facts, float16 pixels.
  take(buffer) {
    const length = new DataView(buffer).getUint32(0, true);
    const facts = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, length)));
    facts.pixels = new Uint16Array(buffer, 4 + length);
    let slot = this.slots[facts.slot];
    if (!slot || slot.full.join() !== facts.full.join()) {
      slot = this.slots[facts.slot] = {full: facts.full, layer: document.createElement("canvas")};
      [slot.layer.width, slot.layer.height] = facts.full;
    }
    if (facts.coarse) [slot.coarse, slot.fine] = [facts, null];
    else slot.fine = facts;
    if (slot.coarse && slot.coarse.revision !== facts.revision) slot.coarse = null;
    this.paint(slot, facts);
    this.redraw();
    return facts;
  }

  // Draw what a slot has to its layer, or the one part that is new.
  paint(slot, only) {
    const context = slot.layer.getContext("2d");
    for (const part of only ? [only] : [slot.coarse, slot.fine]) {
      if (!part) continue;
      const {columns, rows, pixels, box} = part;
      const image = new ImageData(columns, rows), out = image.data, tones = this.tones;
      for (let i = 0, j = 0; i < pixels.length; i += 3, j += 4) {
        const first = pixels[i];
        out[j] = tones[first];
        out[j + 1] = tones[pixels[i + 1]];
        out[j + 2] = tones[pixels[i + 2]];
        out[j + 3] = (first & 0x7fff) > 0x7c00 ? 0 : 255;  // NaN: no samples yet
      }
      const own = document.createElement("canvas");
      [own.width, own.height] = [columns, rows];
      own.getContext("2d").putImageData(image, 0, 0);
      context.imageSmoothingEnabled = true;
      context.drawImage(own, box[0], box[1], box[2] - box[0], box[3] - box[1]);
    }
  }

  get full() { return (this.slots[this.shown] || Object.values(this.slots)[0] || {full: [1, 1]}).full; }

  // Scale and corner of the picture, in pixels of the canvas.
  place() {
    const [w, h] = this.full, {width, height} = this.canvas;
    const fitted = Math.min(width / w, height / h, Math.max(1, 4 * devicePixelRatio));
    const scale = this.scale ?? 0.96 * fitted;
    const x = Math.round(0.5 * (width - w * scale) + this.offset[0]);
    const y = Math.round(0.5 * (height - h * scale) + this.offset[1]);
    return {scale, x, y};
  }

  // From a place on the screen to one of the picture [pixels].
  at(event) {
    const box = this.canvas.getBoundingClientRect(), {scale, x, y} = this.place();
    return [((event.clientX - box.left) * devicePixelRatio - x) / scale,
            ((event.clientY - box.top) * devicePixelRatio - y) / scale];
  }

  // Radiance of a pixel, or null.
  value(px, py) {
    const slot = this.slots[this.split ? (px < this.wipe * this.full[0] ? "A" : "B") : this.shown];
    const part = slot && (slot.fine || slot.coarse);
    if (!part) return null;
    const {box, columns, rows, pixels} = part;
    const x = Math.floor((px - box[0]) / (box[2] - box[0]) * columns);
    const y = Math.floor((py - box[1]) / (box[3] - box[1]) * rows);
    if (x < 0 || y < 0 || x >= columns || y >= rows) return null;
    const at = 3 * (y * columns + x);
    return [VALUES[pixels[at]], VALUES[pixels[at + 1]], VALUES[pixels[at + 2]]];
  }

  zoom(factor, event) {
    const before = this.place(), box = this.canvas.getBoundingClientRect();
    const cx = event ? (event.clientX - box.left) * devicePixelRatio : this.canvas.width / 2;
    const cy = event ? (event.clientY - box.top) * devicePixelRatio : this.canvas.height / 2;
    const scale = Math.min(Math.max(before.scale * factor, 0.05), 64), [w, h] = this.full;
    const x = cx - (cx - before.x) * scale / before.scale, y = cy - (cy - before.y) * scale / before.scale;
    this.scale = scale;
    this.offset = [x - 0.5 * (this.canvas.width - w * scale), y - 0.5 * (this.canvas.height - h * scale)];
    this.redraw();
  }

  move(dx, dy) {
    if (this.scale === null) this.scale = this.place().scale;
    this.offset[0] += dx * devicePixelRatio;
    this.offset[1] += dy * devicePixelRatio;
    this.redraw();
  }

  fit() { [this.scale, this.offset] = [null, [0, 0]]; this.redraw(); }
  oneToOne() { [this.scale, this.offset] = [devicePixelRatio, [0, 0]]; this.redraw(); }

  redraw() {
    if (this.waiting) return;
    this.waiting = true;
    requestAnimationFrame(() => { this.waiting = false; this.draw(); });
  }

  draw() {
    const {canvas, context} = this, box = canvas.getBoundingClientRect();
    const width = Math.max(1, Math.round(box.width * devicePixelRatio));
    const height = Math.max(1, Math.round(box.height * devicePixelRatio));
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    context.clearRect(0, 0, width, height);
    const {scale, x, y} = this.place(), [w, h] = this.full;
    context.imageSmoothingEnabled = scale < 2;
    context.imageSmoothingQuality = "high";
    const put = (name, left, right) => {
      const slot = this.slots[name];
      if (!slot || right <= left) return;
      context.drawImage(slot.layer, left, 0, right - left, h, x + left * scale, y, (right - left) * scale, h * scale);
    };
    if (this.split) {
      const cut = Math.round(this.wipe * w);
      put("A", 0, cut);
      put("B", cut, w);
      context.fillStyle = "#fff";
      context.fillRect(Math.round(x + cut * scale), y, 1, h * scale);
      context.font = `600 ${12 * devicePixelRatio}px system-ui, sans-serif`;
      context.shadowColor = "#000";
      context.shadowBlur = 4;
      context.textAlign = "right";
      context.fillText("A", x + cut * scale - 8, y + 20 * devicePixelRatio);
      context.textAlign = "left";
      context.fillText("B", x + cut * scale + 8, y + 20 * devicePixelRatio);
      context.shadowBlur = 0;
    } else put(this.shown, 0, w);
    if (this.region) {
      const [left, top, right, bottom] = this.region;
      context.strokeStyle = "#fff";
      context.setLineDash([4, 4]);
      context.strokeRect(x + left * scale + 0.5, y + top * scale + 0.5, (right - left) * scale, (bottom - top) * scale);
      context.setLineDash([]);
    }
    this.onZoom(scale / devicePixelRatio);
  }
}
