// The robot at one row: stones, the area that both barriers allow, friction cone, force, legs. x, z in m.

import {colour} from "theme";

const VIEW = {left: -0.95, right: 1.25, bottom: -0.2, top: 1.55}; // around the hip; the ground is at 0
const DEPTH = 0.12, AREA_HEIGHT = 0.2, AREA_LEFT = -0.45, CONE_HEIGHT = 0.3; // m, as in geometry.py
const FORCE_SCALE = 1e-3, LONGEST_ARROW = 0.9; // m per N, m
const OUTCOMES = {walked: "walked the course", fall: "fell", gap_fall: "fell into a gap", miss: "missed a stone", slip: "slipped", flight: "left the ground", stall: "stands still"};
const PUSHED = 4; // see EVENTS in rows.py

class Canvas {
  constructor(parent, walker) {
    this.walker = walker;
    this.canvas = document.createElement("canvas");
    this.canvas.setAttribute("role", "img");
    this.canvas.setAttribute("aria-label", `walk of the ${walker.about.name} controller`);
    parent.append(this.canvas);
    this.pen = this.canvas.getContext("2d");
  }

  // cleared, as large as it is shown; pixels of the screen for one of the page
  begin() {
    const {canvas, pen} = this, ratio = devicePixelRatio || 1;
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (canvas.width !== width || canvas.height !== height) Object.assign(canvas, {width, height});
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, width, height);
    return {ratio, width, height};
  }

  // in the corners: what is shown, and how it ended
  words(lines, said, isGood) {
    const {pen, walker} = this, width = this.canvas.clientWidth - 20, ratio = devicePixelRatio || 1;
    pen.setTransform(ratio, 0, 0, ratio, 0, 0);
    pen.textBaseline = "top";
    pen.fillStyle = colour("text");
    pen.font = "600 15px system-ui, sans-serif";
    pen.fillText(walker.about.name, 10, 8, width - pen.measureText(said).width - 10);
    pen.font = "13px system-ui, sans-serif";
    lines.filter(Boolean).forEach((line, i) => pen.fillText(line, 10, 28 + 18 * i, width));
    pen.font = "600 15px system-ui, sans-serif";
    pen.textAlign = "right";
    pen.fillStyle = colour(isGood ? "next" : "force");
    pen.fillText(said, width + 10, 8);
    pen.textAlign = "left";
  }
}

// What a task of one's own draws: in the columns `shape0`, ... of each shape how many points (a disc has none), its
// colour, its width in px or its radius, and x, z of each point.
export class Picture extends Canvas {
  constructor(parent, walker) {
    super(parent, walker);
    this.box = [Infinity, Infinity, -Infinity, -Infinity]; // left, bottom, right, top of all pictures
    this.seen = 0; // rows
  }

  *shapes(row) {
    const {shapes: most} = this.walker.about, from = row * this.walker.walk.width + this.walker.column.shape0;
    const numbers = most ? this.walker.walk.data.subarray(from, from + most) : [];
    for (let i = 0; numbers[i] >= 0;) {
      const [count, hue, size] = numbers.slice(i, i + 3), end = i + 3 + 2 * Math.max(count, 1);
      const points = Array.from({length: Math.max(count, 1)}, (_, k) => [numbers[i + 3 + 2 * k], numbers[i + 4 + 2 * k]]);
      yield {isLine: count > 0, points, size, hue: `#${hue.toString(16).padStart(6, "0")}`};
      i = end;
    }
  }

  look() {
    for (; this.seen < this.walker.walk.length; this.seen++) {
      for (const {isLine, points, size} of this.shapes(this.seen)) {
        for (const [x, z] of points) {
          const room = isLine ? 0 : size, [left, bottom, right, top] = this.box;
          if (Number.isFinite(x + z)) this.box = [Math.min(left, x - room), Math.min(bottom, z - room), Math.max(right, x + room), Math.max(top, z + room)];
        }
      }
    }
  }

  draw(row, ended) {
    this.look();
    const {ratio, width, height} = this.begin(), {pen, walker} = this, [left, bottom, right, top] = this.box;
    const scale = 0.85 * Math.min(width / (right - left || 1), height / (top - bottom || 1));
    pen.setTransform(scale, 0, 0, -scale, width / 2 - scale * (left + right) / 2, height / 2 + scale * (bottom + top) / 2);
    for (const {isLine, points, size, hue} of Number.isFinite(scale) ? this.shapes(row) : []) {
      pen.beginPath();
      if (isLine) points.forEach(([x, z]) => pen.lineTo(x, z));
      else pen.arc(...points[0], size, 0, 2 * Math.PI);
      const shown = hue === "#000000" ? colour("text") : hue; // black on dark is not seen
      Object.assign(pen, {strokeStyle: shown, fillStyle: shown, lineWidth: size * ratio / scale, lineJoin: "round"});
      isLine ? pen.stroke() : pen.fill();
    }
    const lines = walker.about.barriers.map((name) => `${name}: ${walker.get(row, name).toFixed(3)}`);
    this.words([`${walker.walk.time(row).toFixed(2)} s`, ...lines, ...(walker.about.note ?? [])], ended?.outcome ?? "", ended?.outcome === "done" && !/broken/.test(ended.reason));
  }
}

export class Scene extends Canvas {
  draw(row, ended) {
    const {ratio, width, height} = this.begin(), {pen, walker} = this;
    const scale = Math.min(width / (VIEW.right - VIEW.left), height / (VIEW.top - VIEW.bottom));
    const [hip] = walker.point(row, "hip");
    const middle = hip + (VIEW.left + VIEW.right) / 2, slope = ((this.slope ?? walker.about.slope ?? 0) * Math.PI) / 180;
    const [a, b] = [scale * Math.cos(slope), scale * Math.sin(slope)]; // the ground is level in the plant's frame
    pen.setTransform(a, -b, -b, -a, width / 2 - middle * a, height + VIEW.bottom * scale + middle * b);
    this.pixel = ratio / scale; // a pixel of the page, in m
    this.span = [hip - width / scale, hip + width / scale];
    const stance = walker.get(row, "stance") ? "right" : "left", swing = stance === "left" ? "right" : "left";
    const foot = walker.point(row, stance + "_foot");
    this.area(row, foot);
    this.ground(row);
    this.cone(foot);
    this.trace(row, swing);
    this.leg(row, swing, "swing");
    this.leg(row, stance, "stance");
    this.torso(row);
    this.force(row, foot);
    this.say(row, ended);
  }

  path(points, closed = false) {
    this.pen.beginPath();
    points.forEach(([x, z], i) => (i ? this.pen.lineTo(x, z) : this.pen.moveTo(x, z)));
    if (closed) this.pen.closePath();
  }

  stroke(name, pixels, dash = []) {
    const {pen} = this;
    Object.assign(pen, {strokeStyle: colour(name), lineWidth: pixels * this.pixel, lineCap: "round", lineJoin: "round"});
    pen.setLineDash(dash.map((length) => length * this.pixel));
    pen.stroke();
    pen.setLineDash([]);
  }

  fill(name) {
    this.pen.fillStyle = colour(name);
    this.pen.fill();
  }

  area(row, [x]) {
    const {R1, R2, stone_margin: margin = 0} = this.walker.about;
    const near = this.walker.get(row, "stone_near") - x + margin, far = this.walker.get(row, "stone_far") - x - margin;
    if (!Number.isFinite(near) || R1 === undefined || !this.walker.get(row, "running")) return;
    const points = [];
    for (let i = 0; i < 20; i++) {
      const along = (near * i) / 19;
      points.push([along, Math.sqrt((near / 2) ** 2 + R2 ** 2 - (along - near / 2) ** 2) - R2]);
    }
    for (let i = 0; i < 8; i++) {
      const z = (AREA_HEIGHT * i) / 7;
      points.push([Math.sqrt((R1 + far) ** 2 - z ** 2) - R1, z]);
    }
    points.push([AREA_LEFT, AREA_HEIGHT], [AREA_LEFT, 0]);
    const top = this.walker.get(row, "stone_top"); // from which the barriers count
    this.path(points.map(([a, z]) => [a + x, z + top]), true);
    this.fill("area");
  }

  ground(row) {
    const {pen, walker} = this;
    const isFlat = !walker.stones.length;
    const stones = isFlat ? [{row: 0, near: this.span[0], far: this.span[1], top: 0}] : walker.stones.filter((stone) => stone.row <= row);
    stones.forEach(({near, far, top}, i) => {
      if (far < this.span[0] || near > this.span[1]) return;
      const isNext = !isFlat && i === stones.length - 1;
      pen.beginPath();
      pen.rect(near, top - DEPTH, far - near, DEPTH);
      this.fill(isNext ? "next" : "stone");
      for (const edge of [near, far]) {
        this.path([[edge, top - DEPTH], [edge, top + 0.012]]);
        this.stroke("text", 1.5);
      }
    });
  }

  cone([x, z]) {
    const reach = this.walker.about.friction_coeff * CONE_HEIGHT;
    if (!Number.isFinite(reach)) return;
    this.path([[x + reach, z + CONE_HEIGHT], [x, z], [x - reach, z + CONE_HEIGHT]]);
    this.stroke("cone", 1.5, [5, 4]);
  }

  trace(row, swing) {
    const step = this.walker.get(row, "step");
    const points = [];
    for (let i = row; i >= 0 && this.walker.get(i, "step") === step; i--) points.push(this.walker.point(i, swing + "_foot"));
    this.path(points);
    this.stroke("swing", 1.5, [1, 4]);
  }

  leg(row, side, role) {
    const {pen} = this;
    const points = ["hip", side + "_knee", side + "_foot"].map((name) => this.walker.point(row, name));
    this.path(points);
    this.stroke(role, role === "stance" ? 7 : 4, role === "stance" ? [] : [9, 6]);
    for (const [x, z] of points.slice(1)) {
      pen.beginPath();
      pen.arc(x, z, (role === "stance" ? 5 : 3.5) * this.pixel, 0, 2 * Math.PI);
      this.fill(role);
    }
  }

  torso(row) {
    this.path([this.walker.point(row, "hip"), this.walker.point(row, "head")]);
    this.stroke("torso", 9);
  }

  force(row, [x, z]) {
    const force = [this.walker.get(row, "F_T") * FORCE_SCALE, this.walker.get(row, "F_N") * FORCE_SCALE];
    const size = Math.hypot(...force);
    if (!(size > 0.01)) return;
    const shown = Math.min(1, LONGEST_ARROW / size);
    const [a, b] = force.map((part) => part * shown);
    const [ux, uz] = [a / Math.hypot(a, b), b / Math.hypot(a, b)], head = 10 * this.pixel;
    this.path([[x, z], [x + a, z + b]]);
    this.stroke("force", 2.5);
    this.path([[x + a, z + b], [x + a - head * (ux + uz / 2), z + b - head * (uz - ux / 2)], [x + a - head * (ux - uz / 2), z + b - head * (uz + ux / 2)]], true);
    this.fill("force");
  }

  say(row, ended) {
    const {walker} = this, total = walker.walk.about.stones, slope = this.slope ?? walker.about.slope;
    const stones = `${ended?.stones ?? walker.get(row, "touchdowns")}${total ? ` of ${total}` : ""} stones`;
    const said = ended ? OUTCOMES[ended.outcome] ?? (ended.reason ? "fell" : ended.outcome) : "";
    const title = this.canvas.clientWidth > 520 && walker.about.title?.split(": ")[1];
    const lines = [title, stones, slope && `ground rises ${slope}°`, walker.get(row, "events") & PUSHED && "pushed"];
    this.words(lines, said, ended?.outcome === "walked");
  }
}
