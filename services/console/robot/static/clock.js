// The service's monotonic clock, as far as the quickest message tells.

export class Clock {
  constructor(link) {
    this.offset = null; // seconds from the service's clock to the page's
    link.on("beat", (beat) => {
      if (beat === undefined) return;
      const offset = performance.now() / 1000 - beat;
      this.offset = this.offset === null || Math.abs(offset - this.offset) > 5 ? offset : Math.min(this.offset, offset);
    });
    link.addEventListener("lost", () => { this.offset = null; });
  }

  /** Now, on the service's clock; null while that is unknown. */
  now() { return this.offset === null ? null : performance.now() / 1000 - this.offset; }
}

/** Seconds as people say them. */
export function duration(seconds) {
  if (seconds < 10) return `${Math.max(seconds, 0).toFixed(1)} s`;
  if (seconds < 100) return `${Math.round(seconds)} s`;
  if (seconds < 6000) return `${Math.round(seconds / 60)} min`;
  if (seconds < 360000) return `${Math.round(seconds / 3600)} h`;
  return `${Math.round(seconds / 86400)} d`;
}
