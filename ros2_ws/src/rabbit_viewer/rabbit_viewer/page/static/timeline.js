// The time line that can be dragged, its marks, and the buttons of what is played back here.

import {colour} from "theme";

const NAMES = {saturated: "torque limit", rescued: "slack of last resort", over_cone: "over the cone", pushed: "pushed", swapped: "policy swapped"};
const COLOURS = {saturated: "swing", rescued: "plot4", over_cone: "force", pushed: "text", swapped: "next"};

export class Timeline {
  constructor(element, clock) {
    this.clock = clock;
    this.buttons = element.querySelector(".buttons");
    this.range = element.querySelector("input");
    this.canvas = element.querySelector("canvas");
    this.output = element.querySelector("output");
    this.range.oninput = () => clock.walk && clock.seek(Number(this.range.value));
    clock.isLive ? this.liveButtons() : this.recordingButtons();
  }

  liveButtons() {
    this.follow = this.button("live", "Follow", "follow the walk (f)", () => this.clock.follow());
  }

  recordingButtons() {
    this.play = this.button("play", "Pause", "play, hold (space)", () => this.clock.toggle());
    this.button("back", "◀", "one tick back (left)", () => this.clock.seek(this.clock.row - 1));
    this.button("on", "▶", "one tick on (right)", () => this.clock.seek(this.clock.row + 1));
    const rate = document.createElement("select");
    rate.id = "rate";
    rate.setAttribute("aria-label", "speed");
    rate.append(...[0.1, 0.25, 0.5, 1, 2, 4].map((value) => new Option(`${value} x`, value, value === 1, value === 1)));
    rate.onchange = () => { this.clock.rate = Number(rate.value); };
    this.buttons.append(rate);
  }

  button(id, text, title, onclick) {
    const button = Object.assign(document.createElement("button"), {id, textContent: text, title, onclick});
    this.buttons.append(button);
    return button;
  }

  draw() {
    const {clock} = this;
    const last = Math.max(clock.walk.length - 1, 0);
    this.range.max = last;
    if (clock.row >= 0) this.range.value = clock.row;
    this.output.textContent = clock.row >= 0 ? `${clock.walk.time(clock.row).toFixed(2)} s` : "";
    this.follow?.setAttribute("aria-pressed", clock.isFollowing);
    if (this.play) this.play.textContent = clock.isPlaying ? "Hold" : "Play";
    this.marks(last);
  }

  marks(last) {
    const ratio = devicePixelRatio || 1, {canvas} = this;
    Object.assign(canvas, {width: canvas.clientWidth * ratio, height: canvas.clientHeight * ratio});
    const pen = canvas.getContext("2d");
    pen.scale(ratio, ratio);
    const along = (row) => 8 + (canvas.clientWidth - 16) * (last ? row / last : 0);
    this.clock.walk.walkers.forEach((walker, i) => {
      for (const {row, kind} of walker.marks) {
        pen.fillStyle = colour(kind === "stone" ? "faint" : COLOURS[kind]);
        if (kind === "stone") pen.fillRect(along(row), 7 * i, 1.5, 6);
        else triangle(pen, along(row), 7 * i);
      }
    });
    canvas.title = Object.values(NAMES).join(", ");
  }
}

function triangle(pen, x, y) {
  pen.beginPath();
  pen.moveTo(x - 3, y + 6);
  pen.lineTo(x + 3, y + 6);
  pen.lineTo(x, y);
  pen.fill();
}
