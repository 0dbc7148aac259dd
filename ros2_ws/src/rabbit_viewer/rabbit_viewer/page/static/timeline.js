// The time line that can be dragged, its marks, and the buttons of what is played back here.

import {colour} from "theme";

export const MARKS = {saturated: ["plot4", "torque limit"], over_cone: ["force", "over the cone"], pushed: ["text", "pushed"], swapped: ["next", "policy swapped"]};
const LANE = 12; // px, of a walker

export class Timeline {
  constructor(element, clock, onclick) {
    this.clock = clock;
    this.buttons = element.querySelector(".buttons");
    this.range = element.querySelector("input");
    this.canvas = element.querySelector("canvas");
    this.output = element.querySelector("output");
    this.range.oninput = () => clock.walk && clock.seek(Number(this.range.value));
    this.range.onchange = onclick; // when the mouse is let go
  }

  begin() {
    this.output.textContent = "";
    this.canvas.width = 0; // clears it
    if (this.isLive === this.clock.isLive) return;
    this.isLive = this.clock.isLive;
    this.buttons.replaceChildren();
    this.isLive ? this.liveButtons() : this.recordingButtons();
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
    if (this.isLive) this.follow.setAttribute("aria-pressed", clock.isFollowing);
    else this.play.textContent = clock.isPlaying ? "Hold" : "Play";
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
        if (kind === "stone") {
          pen.fillStyle = colour("faint");
          pen.fillRect(along(row), LANE * i, 1, LANE - 2);
        } else {
          pen.fillStyle = colour(MARKS[kind][0]);
          triangle(pen, along(row), LANE * i + LANE - 8);
        }
      }
    });
  }
}

function triangle(pen, x, y) {
  pen.beginPath();
  pen.moveTo(x - 4, y + 6);
  pen.lineTo(x + 4, y + 6);
  pen.lineTo(x, y);
  pen.fill();
}
