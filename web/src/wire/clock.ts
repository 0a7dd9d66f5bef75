/**
 * Estimate of the server's clock, so that "4 ms old" is true on a tablet whose own clock is minutes off.
 *
 * A ping carries our time t, the answer the server's time s, and it comes back at t'. The server read its clock between t and t', so
 * s − (t + t')/2 is its lead over us, wrong by at most half the round trip. The ping with the shortest round trip among the last ones
 * is used; old ones are dropped because the two clocks drift against each other.
 */

/** Pings remembered: at one every 5 s, drift of 50 ppm moves the clocks by 4 ms in this time. */
const MAX_PINGS = 16;

export class ServerClock {
  readonly #pings: { readonly offset: number; readonly rtt: number }[] = [];

  /**
   * @param sent our time when the ping left, s
   * @param server the server's time in the answer, s
   * @param received our time when the answer came, s
   */
  add(sent: number, server: number, received: number): void {
    const rtt = received - sent;
    if (!(rtt >= 0) || !Number.isFinite(server)) return; // our clock was set in between: this ping is useless
    this.#pings.push({ offset: server - (sent + received) / 2, rtt });
    if (this.#pings.length > MAX_PINGS) this.#pings.shift();
  }

  /** Server time minus our time, s, with its uncertainty; undefined before the first ping. */
  get estimate(): { readonly offset: number; readonly uncertainty: number } | undefined {
    let best = this.#pings[0];
    for (const ping of this.#pings) if (best !== undefined && ping.rtt < best.rtt) best = ping;
    return best === undefined ? undefined : { offset: best.offset, uncertainty: best.rtt / 2 };
  }

  /** Reset, for another server, or after sleep. */
  reset(): void {
    this.#pings.length = 0;
  }
}

/** Our own clock as unix seconds: monotonic, and the same in the page and in its worker. */
export function localNow(): number {
  return (performance.timeOrigin + performance.now()) / 1000;
}
