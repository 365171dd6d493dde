// @ts-check
// Plays a motion: frames in time, at the servos' own speed.

import { byId, setText } from '../shared/dom.js';

export class Player {
  /** @param {(frame: number) => void} onFrame */
  constructor(onFrame) {
    this.onFrame = onFrame;
    this.panel = byId('player', HTMLDivElement);
    this.button = byId('play', HTMLButtonElement);
    this.slider = byId('time', HTMLInputElement);
    this.text = byId('time-text', HTMLOutputElement);
    /** @type {number[]} */
    this.times = [];
    this.frame = 0;
    this.request = 0;
    this.button.addEventListener('click', () => (this.request ? this.pause() : this.play()));
    this.slider.addEventListener('input', () => {
      this.pause();
      this.seek(Number(this.slider.value));
    });
  }

  /** @param {number[]} times  seconds */
  load(times) {
    this.pause();
    this.times = times;
    this.panel.hidden = false;
    this.slider.max = String(times.length - 1);
    this.seek(0);
    this.play();
  }

  close() {
    this.pause();
    this.times = [];
    this.panel.hidden = true;
  }

  play() {
    if (this.frame >= this.times.length - 1) this.seek(0);
    const began = performance.now() / 1000 - this.times[this.frame];
    const step = () => {
      const now = performance.now() / 1000 - began;
      let frame = this.frame;
      while (frame < this.times.length - 1 && this.times[frame + 1] <= now) frame += 1;
      if (frame !== this.frame) this.seek(frame);
      this.request = frame < this.times.length - 1 ? requestAnimationFrame(step) : 0;
      this.label();
    };
    this.request = requestAnimationFrame(step);
    this.label();
  }

  pause() {
    cancelAnimationFrame(this.request);
    this.request = 0;
    this.label();
  }

  /** @param {number} frame */
  seek(frame) {
    this.frame = frame;
    this.slider.value = String(frame);
    setText(
      this.text,
      `${this.times[frame].toFixed(1)} of ${this.times[this.times.length - 1].toFixed(1)} s`,
    );
    this.onFrame(frame);
  }

  label() {
    setText(this.button, this.request ? 'Pause' : 'Play');
    this.button.setAttribute('aria-pressed', String(Boolean(this.request)));
  }
}
