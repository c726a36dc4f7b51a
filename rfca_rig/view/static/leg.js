// The leg as it bends, from the side, beside the model's ghost; y to the right, z down, in millimetres, one scale for both.

import { element, made, number } from "./format.js";

const SVG = "http://www.w3.org/2000/svg";
const MM_PER_N = 1.6;
const LONGEST_ARROW_MM = 190;
const WORTH_AN_ARROW_N = 0.5;
const SOURCES = {
  "model at measured shaft angle": "leg: the model at the measured shaft angle, not seen",
  photo: "leg: as read off the latest photo",
  "shaft only": "only the shaft is known; the rest is drawn straight",
};

export class LegPicture {
  constructor() {
    this.svg = element("leg-picture");
    this.floor = this.add("path", "floor");
    this.earth = this.add("path", "earth");
    this.ghost = this.add("polyline", "ghost");
    this.body = this.add("polyline", "leg");
    this.hinges = this.add("path", "hinges");
    this.shaft = this.add("circle", "shaft");
    this.arrow = this.add("path", "force");
    this.newtons = this.add("text", "newtons");
    this.key = element("leg-key");
  }

  begin(hello) {
    element("leg").classList.toggle("unknown", !hello.leg);
    if (!hello.leg) this.key.replaceChildren("No leg is described, so none is drawn.");
    if (!hello.leg) return;
    this.lengthMm = 1e3 * hello.leg.link_lengths_m.reduce((sum, length) => sum + length, 0);
    this.thicknessMm = Math.max(1e3 * hello.leg.link_thickness_m, 0.012 * this.lengthMm);
    this.body.style.strokeWidth = this.ghost.style.strokeWidth = String(this.thicknessMm);
    this.shaft.setAttribute("r", String(1.3 * this.thicknessMm));
    this.said = "";
  }

  draw(message) {
    const heightMm = 1e3 * message.height_m;
    const points = message.leg.map(([y, z]) => [1e3 * y, 1e3 * z]);
    this.frame(heightMm);
    this.drawFloor(heightMm);
    this.body.setAttribute("points", text(points));
    this.body.classList.toggle("guessed", message.source === "shaft only");
    this.hinges.setAttribute("d", points.slice(1).map(dot).join(""));
    this.ghost.setAttribute("points", message.ghost ? text(message.ghost.map(([y, z]) => [1e3 * y, 1e3 * z])) : "");
    this.drawForce(message.force, points, heightMm);
    this.say(message);
  }

  add(tag, className) {
    const node = document.createElementNS(SVG, tag);
    node.setAttribute("class", className);
    this.svg.append(node);
    return node;
  }

  // room for the leg stretched to all sides, so that the picture never jumps
  frame(heightMm) {
    const half = 1.06 * this.lengthMm;
    const depth = heightMm + 0.08 * this.lengthMm;
    const box = `${-half} ${-half} ${2 * half} ${half + depth}`;
    if (box !== this.box) this.svg.setAttribute("viewBox", box);
    this.box = box;
    this.halfMm = half;
  }

  drawFloor(heightMm) {
    if (heightMm === this.drawnHeightMm) return;
    this.drawnHeightMm = heightMm;
    const [half, step] = [this.halfMm, this.lengthMm / 22];
    this.floor.setAttribute("d", `M${-half} ${heightMm}H${half}`);
    const strokes = [];
    for (let y = -half; y < half; y += step) strokes.push(`M${y} ${heightMm + 0.75 * step}l${0.75 * step} ${-0.75 * step}`);
    this.earth.setAttribute("d", strokes.join(""));
  }

  // the sensor's z is down and its y against the plane's; a force of the ground is drawn where the leg touches, any other at the shaft
  drawForce(force, points, heightMm) {
    const [along, down] = force ? [-force[0], force[1]] : [0, 0];
    const size = Math.hypot(along, down);
    const isShown = size >= WORTH_AN_ARROW_N;
    this.arrow.setAttribute("d", "");
    this.newtons.textContent = "";
    if (!isShown) return;
    const lowest = points.reduce((a, b) => (b[1] > a[1] ? b : a));
    const touches = lowest[1] + this.thicknessMm >= heightMm;
    const from = touches ? lowest : points[0];
    const length = Math.min(MM_PER_N * size, LONGEST_ARROW_MM);
    const unit = [along / size, down / size];
    this.arrow.setAttribute("d", arrow(from, unit, length, this.thicknessMm));
    this.newtons.textContent = `${number(size)} N`;
    const side = touches ? Math.sign(unit[0]) : -Math.sign(points.at(-1)[0]); // beside the arrow's tip, or away from the leg
    this.newtons.setAttribute("text-anchor", side < 0 ? "end" : "start");
    this.newtons.setAttribute("x", String(from[0] + length * unit[0] + (side < 0 ? -14 : 14)));
    this.newtons.setAttribute("y", String(from[1] + length * unit[1] + (touches ? 0 : 10)));
  }

  say(message) {
    const said = `${message.source} ${Boolean(message.ghost)} ${Boolean(message.force)} ${message.height_m}`;
    if (said === this.said) return;
    this.said = said;
    this.key.replaceChildren(made("span", SOURCES[message.source] ?? `leg: ${message.source}`, "of-leg"));
    if (message.ghost) this.key.append(made("span", "ghost: the nominal model at the commanded angle", "of-ghost"));
    if (message.force) this.key.append(made("span", "force as the sensor feels it, weight included", "of-force"));
    this.key.append(made("span", `shaft ${number(1e3 * message.height_m)} mm above the floor`, "of-floor"));
    this.svg.setAttribute("aria-label", `side view of the leg. ${this.key.innerText}`);
  }
}

function text(points) {
  return points.map(([y, z]) => `${y.toFixed(2)},${z.toFixed(2)}`).join(" ");
}

function dot([y, z]) {
  return `M${y.toFixed(2)} ${z.toFixed(2)}h0`;
}

function arrow([y, z], [uy, uz], length, head) {
  const tip = [y + uy * length, z + uz * length];
  const wing = Math.min(2.6 * head, 0.5 * length);
  const barb = (side) => `${tip[0] - wing * (uy + 0.5 * side * uz)} ${tip[1] - wing * (uz - 0.5 * side * uy)}`;
  return `M${y} ${z}L${tip[0]} ${tip[1]}M${barb(1)}L${tip[0]} ${tip[1]}L${barb(-1)}`;
}
