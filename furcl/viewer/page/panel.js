// The fibre's numbers as sliders, built from what its model says of them.

const byId = id => document.getElementById(id);

// A slider goes from 0 to 1; a scale above 0 is nearly logarithmic.
const toValue = (field, t) => field.low + (field.high - field.low) * (field.scale ? Math.expm1(field.scale * t) / Math.expm1(field.scale) : t);
const toSlider = (field, value) => {
  const part = (value - field.low) / (field.high - field.low);
  return field.scale ? Math.log1p(part * Math.expm1(field.scale)) / field.scale : part;
};
export const short = value => value === 0 ? "0" : Math.abs(value) >= 1e4 || Math.abs(value) < 1e-3
  ? value.toExponential(2) : String(Number(value.toPrecision(4)));
const label = name => name.replace(/_deg$/, "").replaceAll("_", " ");

export class Panel {
  constructor(send) {
    this.send = send;
    this.built = "";
    this.chosen = 0;
    byId("material").onchange = event => { this.chosen = event.target.selectedIndex; this.built = ""; this.show(this.state); };
    for (const name of ["model", "preset"]) {
      byId(name).onchange = event => send({do: "set", key: `${this.material.key}.${name}`, value: event.target.value});
    }
  }

  get material() { return this.state.materials[this.chosen] ?? this.state.materials[0]; }

  show(state) {
    this.state = state;
    const material = this.material;
    if (!material) return;
    byId("material-label").hidden = state.materials.length < 2;
    options(byId("material"), state.materials.map(m => m.name), material.name);
    options(byId("model"), material.models, material.model);
    const own = material.preset === null ? ["(own numbers)"] : [];
    options(byId("preset"), [...own, ...material.presets], material.preset ?? own[0]);
    byId("preset").parentElement.hidden = material.presets.length === 0;
    const built = JSON.stringify([material.key, material.fields.map(f => [f.name, f.varies, Array.isArray(f.value)])]);
    if (built !== this.built) {
      this.built = built;
      this.rows = material.fields.map(field => this.build(material, field));
      byId("fields").replaceChildren(...this.rows.map(row => row.element));
    }
    material.fields.forEach((field, i) => {
      this.rows[i].set(field);
      this.rows[i].element.classList.toggle("changed", state.changed.includes(`${material.key}.${field.name}`));
    });
  }

  build(material, field) {
    const element = document.createElement("div"), triple = Array.isArray(field.value);
    element.className = triple ? "field triple" : "field";
    element.title = `${field.meaning}, ${short(field.low)} to ${short(field.high)}${field.varies ? "; differs between strands" : ""}`;
    const name = document.createElement(triple ? "span" : "label");
    name.className = "name";
    name.textContent = label(field.name);
    const unit = document.createElement("span");
    unit.className = "unit";
    unit.textContent = field.unit === "1 / fibre radius" ? "/ radius" : field.unit === "deg" ? "°" : field.unit;
    const id = `field-${field.name}`, values = triple ? [...field.value] : [field.value];
    const key = `${material.key}.${field.name}`;
    const tell = () => this.send({do: "set", key, value: triple ? [...values] : values[0]});
    const inputs = values.map((_, i) => {
      const slider = document.createElement("input"), number = document.createElement("input");
      Object.assign(slider, {type: "range", min: 0, max: 1, step: 0.001, disabled: field.varies});
      Object.assign(number, {type: "number", step: "any", min: field.low, max: field.high, disabled: field.varies});
      const called = `${label(field.name)}${triple ? ` ${["red", "green", "blue"][i]}` : ""}`;
      slider.setAttribute("aria-label", called);
      number.setAttribute("aria-label", `${called}, ${field.unit}`);
      if (!triple) { slider.id = id; name.htmlFor = id; }
      slider.oninput = () => {
        values[i] = Number(toValue(field, Number(slider.value)).toPrecision(4));
        values[i] = Math.min(Math.max(values[i], field.low), field.high);
        number.value = short(values[i]);
        tell();
      };
      number.onchange = () => { values[i] = Number(number.value); tell(); };
      slider.ondblclick = () => this.send({do: "reset", key});
      return {slider, number};
    });
    if (triple) {
      element.append(name, unit);
      inputs.forEach(({slider, number}, i) => {
        const channel = document.createElement("span");
        channel.className = "channel";
        channel.textContent = "RGB"[i];
        element.append(channel, slider, number);
      });
    } else element.append(name, inputs[0].number, unit, inputs[0].slider);
    const set = now => (triple ? now.value : [now.value]).forEach((value, i) => {
      const {slider, number} = inputs[i];
      if (slider.matches(":active") || document.activeElement === number) return;
      values[i] = value;
      slider.value = toSlider(field, value);
      slider.setAttribute("aria-valuetext", `${short(value)} ${field.unit}`);
      number.value = short(value);
    });
    return {element, set};
  }
}

function options(select, names, chosen) {
  if (select.dataset.names !== names.join()) {
    select.dataset.names = names.join();
    select.replaceChildren(...names.map(name => new Option(name, name)));
  }
  if (document.activeElement !== select || select.value !== chosen) select.value = chosen;
}
