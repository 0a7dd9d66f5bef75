/**
 * Actions on the view. Every key, button and gesture calls one of these; each is a step from one view to the next. They change the
 * signals of their view (view-state.ts) and nothing else. Facts about the data (the server's clock, the range in memory, the samples
 * around a time, the series on screen) come from the `Horizon` that the plots attach.
 */
import type { PlotSpec, View, ViewSignals } from "./view";

/** The data that the view moves over. */
interface Horizon {
  /** The server's clock, unix s. */
  now(): number;
  /** First and last moment in memory for the selected device; undefined when there is none. */
  bounds(): { readonly first: number; readonly last: number } | undefined;
  /** Time of the sample `steps` samples after (before, if negative) time t; undefined at the ends. */
  step(t: number, steps: number): number | undefined;
  /** Time of the sample nearest to t; undefined while the samples around it are unknown. */
  nearest(t: number): number | undefined;
  /** The plots on screen. */
  plots(): readonly PlotSpec[];
  /** Opens the frame that made the sample nearest to t. */
  bytes?(t: number): void;
  /** Keys of the series on screen, in digit order. */
  series(): readonly string[];
  /** Keys of the series in the same plot as this one. */
  beside(key: string): readonly string[];
}

/** Shortest and longest window, s: 5 ms shows single samples at 2 kHz, a day is more than any ring holds. */
export const SHORTEST = 0.005;
export const LONGEST = 86_400;

const NOTHING: Horizon = {
  now: () => Date.now() / 1000,
  bounds: () => undefined,
  step: () => undefined,
  nearest: () => undefined,
  plots: () => [],
  series: () => [],
  beside: () => [],
};

const spanOf = (seconds: number): number => Math.min(LONGEST, Math.max(SHORTEST, seconds));

export class ViewActions {
  readonly #state: ViewSignals;
  #horizon = NOTHING;
  /** Whether all of memory is shown and kept in view while it grows, until the view is changed otherwise. */
  #fitted = false;
  /** Cursors to be put on a sample as soon as the samples around them are known. */
  readonly #unsettled = new Set<"a" | "b">();

  constructor(state: ViewSignals) {
    this.#state = state;
  }

  /** Attach the data that the view moves over. */
  attachPlots(to: Horizon): void {
    this.#horizon = to;
  }

  /** Right edge of the window, unix s. */
  rightEdge(of: View = this.#state.view.peek()): number {
    return of.live ? this.#horizon.now() : of.end;
  }

  #change(part: Partial<View>): void {
    this.#fitted = false;
    this.#state.view.value = { ...this.#state.view.peek(), ...part };
  }

  /** Keep the window over data: not after now, not entirely before the first sample. */
  #clamped(end: number, span: number): number {
    const first = this.#horizon.bounds()?.first ?? -Infinity;
    return Math.min(Math.max(end, first + span / 10), this.#horizon.now());
  }

  /** Freeze the view where it is. */
  pause(): void {
    if (this.#state.view.peek().live) this.#change({ live: false, end: this.#horizon.now() });
  }

  /** Follow the newest sample again. */
  live(): void {
    this.#change({ live: true });
  }

  /** Move by `windows` window lengths; back is negative. Moving back from live pauses; nothing moves past now. */
  pan(windows: number): void {
    const now = this.#state.view.peek();
    if (now.live && windows >= 0) return;
    this.#change({ live: false, end: this.#clamped(this.rightEdge(now) + windows * now.span, now.span) });
  }

  /** Put the right edge at `end`, as dragging does; at now the view stays paused: only `live` goes live. */
  panTo(end: number): void {
    const { span } = this.#state.view.peek();
    this.#change({ live: false, end: this.#clamped(end, span) });
  }

  /** Multiply the window's length by `factor`, keeping the moment at fraction `at` of its width. Live stays live: now is the right edge. */
  zoom(factor: number, at = 0.5): void {
    const now = this.#state.view.peek();
    const span = spanOf(now.span * factor);
    if (now.live) return this.#change({ span });
    const fixed = now.end - (1 - at) * now.span;
    this.#change({ span, end: this.#clamped(fixed + (1 - at) * span, span) });
  }

  /** Show t0…t1 and stay there. */
  select(t0: number, t1: number): void {
    const [a, b] = t0 < t1 ? [t0, t1] : [t1, t0];
    if (b - a > 0) this.#change({ live: false, end: b, span: spanOf(b - a) });
  }

  /** Show everything in memory. */
  fit(): void {
    const bounds = this.#horizon.bounds();
    if (bounds === undefined) return;
    if (this.#state.view.peek().live) {
      this.#change({ span: spanOf((this.#horizon.now() - bounds.first) * 1.01) });
      this.#fitted = true;
      return;
    }
    this.#change({ end: bounds.last, span: spanOf((bounds.last - bounds.first) * 1.01) });
  }

  /** While everything in memory is shown live, extend the window as memory grows: in steps, so that nothing crawls. */
  keepFitted(): void {
    const bounds = this.#horizon.bounds();
    if (!this.#fitted || bounds === undefined || !this.#state.view.peek().live) return;
    const held = this.#horizon.now() - bounds.first;
    if (held > this.#state.view.peek().span) {
      this.#change({ span: spanOf(held * 1.1) });
      this.#fitted = true;
    }
  }

  setSpan(seconds: number): void {
    if (Number.isFinite(seconds)) this.#change({ span: spanOf(seconds) });
  }

  /** Put the window's middle at `t`. */
  centreAt(t: number): void {
    const { span } = this.#state.view.peek();
    this.#change({ live: false, end: this.#clamped(t + span / 2, span) });
  }

  /** Open the frame that made the sample at the cursor, or the newest on screen. */
  bytes(): void {
    this.#horizon.bytes?.(this.cursorTime() ?? this.rightEdge());
  }

  /** To the oldest moment in memory. */
  toStart(): void {
    const bounds = this.#horizon.bounds();
    const { span } = this.#state.view.peek();
    if (bounds !== undefined) this.#change({ live: false, end: Math.min(bounds.first + span, this.#horizon.now()) });
  }

  toggleTimeBase(): void {
    this.#change({ timeBase: this.#state.view.peek().timeBase === "device" ? "arrival" : "device" });
  }

  /** Hide or show the series with that key; `alone`: show only it in its plot, or all again if it is alone already. */
  toggleKey(key: string, alone = false): void {
    const all = this.#horizon.beside(key);
    const was = this.#state.hiddenSeries.peek();
    const next = new Set(was);
    if (!alone) {
      if (!next.delete(key)) next.add(key);
    } else if (!was.has(key) && all.every((other) => other === key || was.has(other))) {
      for (const other of all) next.delete(other);
    } else {
      for (const other of all) next.add(other);
      next.delete(key);
    }
    this.#state.hiddenSeries.value = next;
  }

  /** As `toggleKey`, for the series at place `index` on screen, from 0. */
  toggleSeries(index: number, alone = false): void {
    const key = this.#horizon.series()[index];
    if (key !== undefined) this.toggleKey(key, alone);
  }

  /** Where the cursor reads, unix s; undefined when there is none. */
  cursorTime(): number | undefined {
    const at = this.#state.cursor.peek();
    if (at === undefined) return undefined;
    if (at.kind === "pinned") return at.time;
    const now = this.#state.view.peek();
    return this.rightEdge(now) - (1 - at.fraction) * now.span;
  }

  /** Pin the cursor one sample on (or back); the view follows when it would leave the window. */
  stepSample(samples: number): void {
    const now = this.#state.view.peek();
    const t = this.#horizon.step(this.cursorTime() ?? this.rightEdge(now), samples);
    if (t === undefined) return;
    this.pause();
    this.#state.cursor.value = { kind: "pinned", time: t };
    const end = this.rightEdge();
    if (t > end) this.#change({ end: this.#clamped(t, now.span) });
    else if (t < end - now.span) this.#change({ end: t + now.span });
  }

  /** Read at a moment: pause, pin the cursor there, and bring it into the window. */
  goTo(t: number): void {
    const { span } = this.#state.view.peek();
    this.pause();
    this.pin(t);
    const end = this.rightEdge();
    if (t > end || t < end - span) this.centreAt(t);
  }

  /** First and last moment of the data; undefined without any. */
  bounds(): { readonly first: number; readonly last: number } | undefined {
    return this.#horizon.bounds();
  }

  /** Pin the reading cursor, which is A while measuring. */
  pin(time: number): void {
    this.#put("a", time);
    this.#settle("a");
  }

  /** Pin cursor A, and move the window there if it is outside. */
  pinInView(time: number): void {
    const right = this.rightEdge();
    if (time > right || time < right - this.#state.view.peek().span) this.centreAt(time);
    this.pin(time);
  }

  /** Pin cursor B, for measuring. */
  pinMeasure(time: number): void {
    this.#put("b", time);
    this.#settle("b");
  }

  /** Move cursor B by samples; the view stays. */
  stepMeasure(samples: number): void {
    const at = this.#state.measure.peek();
    const t = at === undefined ? undefined : this.#horizon.step(at, samples);
    if (t !== undefined) this.#put("b", t);
  }

  /** Begin measuring with both cursors in the window, or end it: B goes. A pinned cursor in the window stays where it is. */
  toggleMeasure(): void {
    if (this.#state.measure.peek() !== undefined) {
      this.#state.measure.value = undefined;
      return;
    }
    const now = this.#state.view.peek();
    const end = this.rightEdge(now);
    const bounds = this.#horizon.bounds();
    const last = Math.min(end, bounds?.last ?? end);
    const inMemory = last - Math.max(end - now.span, bounds?.first ?? -Infinity);
    const third = (inMemory > 0 ? inMemory : now.span) / 3;
    const at = this.#state.cursor.peek();
    const isInside = at?.kind === "pinned" && at.time >= end - now.span && at.time <= end;
    const a = isInside ? at.time : last - 2 * third;
    if (!isInside) this.pin(a);
    this.pinMeasure(a + third <= last ? a + third : a - third);
  }

  /** The plots on screen. */
  plots(): readonly PlotSpec[] {
    return this.#horizon.plots();
  }

  setSnap(on: boolean): void {
    this.#state.snap.value = on;
    if (!on) return this.#unsettled.clear();
    if (this.#state.cursor.peek()?.kind === "pinned") this.#settle("a");
    if (this.#state.measure.peek() !== undefined) this.#settle("b");
  }

  #put(which: "a" | "b", time: number): void {
    if (which === "a") this.#state.cursor.value = { kind: "pinned", time };
    else this.#state.measure.value = time;
  }

  /** Put a cursor on the nearest sample, now or once that is known, if cursors snap. */
  #settle(which: "a" | "b"): void {
    if (!this.#state.snap.peek()) return;
    const time = which === "a" ? this.cursorTime() : this.#state.measure.peek();
    const nearest = time === undefined ? undefined : this.#horizon.nearest(time);
    if (time !== undefined && nearest === undefined) this.#unsettled.add(which);
    else this.#unsettled.delete(which);
    if (nearest !== undefined && nearest !== time) this.#put(which, nearest);
  }

  /** Put waiting cursors on their samples; called every frame. */
  settle(): void {
    for (const which of [...this.#unsettled]) this.#settle(which);
  }

  /**
   * Live, a pin moves left with the data; remove one that has left the window: nothing reads off-screen samples. Two pins measure,
   * and stay for as long as memory has all that lies between them.
   */
  dropPassed(): void {
    const now = this.#state.view.peek();
    if (!now.live) return;
    const at = this.#state.cursor.peek();
    const isPair = at?.kind === "pinned" && this.#state.measure.peek() !== undefined;
    const edge = this.rightEdge(now) - now.span;
    const first = isPair ? Math.min(edge, this.#horizon.bounds()?.first ?? edge) : edge;
    if (at?.kind === "pinned" && at.time < first) this.#state.cursor.value = undefined;
    if ((this.#state.measure.peek() ?? Infinity) < first) this.#state.measure.value = undefined;
  }

  /** Side of the window on which the reading cursor is; undefined if inside, or without one. */
  cursorBeside(): "before" | "after" | undefined {
    const at = this.#state.cursor.peek();
    if (at?.kind !== "pinned") return undefined;
    const now = this.#state.view.peek();
    const end = this.rightEdge(now);
    return at.time > end ? "after" : at.time < end - now.span ? "before" : undefined;
  }

  /** Remove both pins. */
  unpin(): void {
    this.#state.cursor.value = undefined;
    this.#state.measure.value = undefined;
  }
}
