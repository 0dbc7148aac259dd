// Which row is shown. It follows the newest one, or stands where it was put, or plays on from there.

export class Clock {
  constructor() {
    this.rate = 1;
    this.begin(null, false);
  }

  begin(walk, isLive) {
    this.walk = walk;
    this.isLive = isLive;
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
    if (this.isFollowing) {
      row = last;
      this.at = this.walk.time(row);
    } else if (this.isPlaying) {
      this.at = Math.min(this.at + (elapsed / 1000) * this.rate, this.walk.time(last));
      row = this.rowAt(this.at);
      if (row === last) this.isPlaying = false;
    }
    const moved = row !== this.row;
    this.row = Math.max(row, 0);
    return moved;
  }

  seek(row) {
    const last = this.walk.length - 1;
    this.row = Math.min(Math.max(row, 0), last);
    this.at = this.walk.time(this.row);
    this.isFollowing = this.isLive && this.row === last;
    this.isPlaying = false;
  }

  follow() {
    this.isFollowing = true;
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
