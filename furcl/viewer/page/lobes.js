// The lobes of a fibre: around it, along it, and what they carry.

const COLOURS = ["#56b4e9", "#e69f00", "#35b58a", "#d98cb5", "#e8dc5a", "#e07b39", "#7f8fe0",
                 "#9ccc65", "#b08cd9", "#7fd1d1", "#d0d0d0"];  // apart for the colour-blind as well

const context = canvas => {
  const side = Math.max(1, Math.round(canvas.clientWidth * devicePixelRatio));
  canvas.width = canvas.height = side;
  const c = canvas.getContext("2d");
  c.lineJoin = "round";
  c.lineWidth = 1.5 * devicePixelRatio;
  return [c, side];
};

export function drawLobes(found) {
  const lobes = Object.entries(found.lobes).map(([name, lobe], i) => ({name, ...lobe, colour: COLOURS[i % COLOURS.length]}))
    .filter(lobe => Math.max(...lobe.energy) > 1e-5);
  polar(document.getElementById("polar"), found.phi, lobes);
  along(document.getElementById("along"), found.theta, lobes);
  const total = lobes.reduce((sum, lobe) => sum + mean(lobe.energy), 0);
  document.getElementById("legend").replaceChildren(...lobes.map(lobe => {
    const item = document.createElement("li"), mark = document.createElement("i");
    mark.style.background = lobe.colour;
    item.append(mark, `${lobe.name} ${percent(mean(lobe.energy) / total)}`);
    item.title = `${lobe.name}: ${lobe.energy.map(e => e.toPrecision(3)).join(", ")} of the light, red, green, blue`;
    return item;
  }));
  const shown = found.albedo.map(x => Math.round(255 * srgb(Math.min(Math.max(x, 0), 1))));
  document.querySelector("#albedo .swatch").style.background = `rgb(${shown})`;
  document.getElementById("albedo-text").textContent =
    `albedo ${found.albedo.map(x => x.toFixed(3)).join(", ")}`;
}

const mean = values => values.reduce((a, b) => a + b, 0) / values.length;
const percent = x => `${(100 * x).toPrecision(2)} %`;
const srgb = x => x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055;

// Radius: fourth root, so that weak lobes are seen beside strong ones.
function polar(canvas, phi, lobes) {
  const [c, side] = context(canvas), middle = side / 2, most = 0.44 * side;
  const top = Math.max(1e-9, ...lobes.flatMap(lobe => lobe.N));
  c.strokeStyle = "#383838";
  c.lineWidth = devicePixelRatio;
  for (const part of [1, 0.5]) {
    c.beginPath();
    c.arc(middle, middle, most * part, 0, 2 * Math.PI);
    c.stroke();
  }
  c.beginPath();
  c.moveTo(middle - most, middle); c.lineTo(middle + most, middle);
  c.moveTo(middle, middle - most); c.lineTo(middle, middle + most);
  c.stroke();
  c.lineWidth = 1.5 * devicePixelRatio;
  for (const lobe of lobes) {
    c.strokeStyle = lobe.colour;
    c.beginPath();
    const points = [...phi.map((p, i) => [p, lobe.N[i]]), ...phi.map((p, i) => [-p, lobe.N[i]]).reverse()];
    points.forEach(([p, n], i) => {
      const r = most * Math.max(n / top, 0) ** 0.25;
      // Light comes from the left; phi = 0 goes back there.
      c[i ? "lineTo" : "moveTo"](middle - r * Math.cos(p), middle - r * Math.sin(p));
    });
    c.closePath();
    c.stroke();
  }
  c.fillStyle = "#d0d0d0";
  c.beginPath();
  c.arc(middle, middle, 2.5 * devicePixelRatio, 0, 2 * Math.PI);
  c.fill();
  c.fillStyle = "#8a8a8a";
  c.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
  c.fillText("light →", 4 * devicePixelRatio, middle - 4 * devicePixelRatio);
}

function along(canvas, theta, lobes) {
  const [c, side] = context(canvas), margin = 0.06 * side, base = side - 2.4 * margin;
  const top = Math.max(1e-9, ...lobes.flatMap(lobe => lobe.M));
  const x = t => margin + (side - 2 * margin) * (t / Math.PI + 0.5);
  c.strokeStyle = "#383838";
  c.lineWidth = devicePixelRatio;
  c.beginPath();
  c.moveTo(margin, base); c.lineTo(side - margin, base);
  c.moveTo(x(0), margin); c.lineTo(x(0), base);
  c.stroke();
  c.lineWidth = 1.5 * devicePixelRatio;
  for (const lobe of lobes) {
    c.strokeStyle = lobe.colour;
    c.beginPath();
    theta.forEach((t, i) => c[i ? "lineTo" : "moveTo"](x(t), base - (base - margin) * Math.sqrt(Math.max(lobe.M[i] / top, 0))));
    c.stroke();
  }
  c.fillStyle = "#8a8a8a";
  c.font = `${10 * devicePixelRatio}px system-ui, sans-serif`;
  c.textAlign = "center";
  const low = side - 0.6 * margin;
  c.fillText("0°", x(0), low);
  c.textAlign = "left";
  c.fillText("root", margin, low);
  c.textAlign = "right";
  c.fillText("tip", side - margin, low);
}
