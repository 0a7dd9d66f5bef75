/** Timers that a file of tests left running: files share a worker, and the next one has other globals, or no document. */

type Timer = ReturnType<typeof setTimeout>;
type Start = (...of: unknown[]) => Timer;

/** One for all files, also after a test that has modules evaluated again. */
const running: Set<Timer> = Reflect.get(globalThis, "timersOfTests") ?? new Set<Timer>();
Reflect.set(globalThis, "timersOfTests", running);

/** Remember each timer from now on, once for all files. */
export function watchTimers(): void {
  for (const name of ["setTimeout", "setInterval"] as const) {
    const start = globalThis[name] as unknown as Start;
    if (Reflect.get(start, "isWatched")) continue;
    const watched: Start = (...of) => {
      const timer = start(...of);
      running.add(timer);
      return timer;
    };
    Reflect.set(globalThis, name, Object.assign(watched, start, { isWatched: true }));
  }
}

export function endTimers(): void {
  for (const timer of running) clearTimeout(timer); // also of an interval
  running.clear();
}
