// Which row is shown. It follows the newest one, or stands where it was put, or plays on from there. Falls are told
// slowly: a walk that is followed or played slows down where a robot falls, and then catches up.

const SLOW = 0.25, CATCHING_UP = 3; // times real time
const BEFORE = 20, AFTER = 10; // rows around a fall that are slow
const LATE = 100, LEAD = 250; // rows: a viewer who comes after so many begins so many before the first fall

export class Clock {
  constructor() {
    this.rate = 1;
    this.begin(null, false);
  }

  begin(walk, isLive, isTold = true) {
    this.walk = walk;
    this.isLive = isLive;
    this.isTold = isTold;
    this.row = -1;
    this.isFollowing = this.isLive;
    this.isPlaying = !this.isLive;
    this.at = 0; // s
  }

  // ms since the last picture; true if another row is to be shown
  advance(elapsed) {
    if (!this.walk?.length) return false;
    const last = this.walk.length - 1;
    let row = this.row;
    if (this.isFollowing && !this.isTold) {
      row = last;
      this.at = this.walk.time(row);
    } else if (this.isFollowing || this.isPlaying) {
      if (row < 0 && this.isLive && last > LATE) this.at = this.walk.time(this.late(last));
      this.at = Math.min(this.at + (elapsed / 1000) * this.rate * this.pace(), this.walk.time(last));
      row = this.rowAt(this.at);
      if (row === last && !this.isFollowing) this.isPlaying = false;
    }
    const moved = row !== this.row;
    this.row = Math.max(row, 0);
    return moved;
  }

  pace() {
    const falls = this.isTold ? this.walk.falls : [];
    if (falls.some(({from, to}) => this.row >= from - BEFORE && this.row <= to + AFTER)) return SLOW;
    const hasMore = falls.some(({from}) => this.row < from);
    return this.isFollowing && !hasMore ? CATCHING_UP : 1;
  }

  late(last) {
    const [first] = this.walk.falls;
    return first ? Math.max(first.from - LEAD, 0) : last;
  }

  seek(row) {
    const last = this.walk.length - 1;
    this.row = Math.min(Math.max(row, 0), last);
    this.at = this.walk.time(this.row);
    this.isFollowing = this.isLive && this.row === last;
    this.isPlaying = this.isTold = false;
  }

  follow() {
    this.isFollowing = true;
    this.isTold = false;
  }

  toggle() {
    if (!this.isPlaying && this.row === this.walk.length - 1) this.at = this.walk.time(0);
    this.isPlaying = !this.isPlaying;
    this.isFollowing = false;
  }

  rowAt(seconds) {
    let low = 0, high = this.walk.length - 1;
    while (low < high) {
      const middle = (low + high + 1) >> 1;
      if (this.walk.time(middle) <= seconds + 1e-9) low = middle;
      else high = middle - 1;
    }
    return low;
  }
}
