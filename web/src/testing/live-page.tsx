/** The whole page as just opened, from a recorded server, in a DOM without a browser. */
import { cleanup, render } from "@testing-library/preact";
import { afterEach, vi } from "vitest";
import { Store } from "../data/store";
import { createViewState } from "../data/view-state";
import { startApp } from "../page/app-state";
import type { App } from "../page/context";
import { startKeyboard } from "../pages/keyboard";
import { parse, route, startRoute } from "../page/route";
import { Shell } from "../shell/shell";
import { RecentHealth } from "../data/health-history";
import { answering, type Answers, type Asked, feed, type Recorded } from "./recorded";

export interface Opened {
  readonly store: Store;
  readonly app: App;
  /** Every request so far. */
  readonly asked: readonly Asked[];
  /** Selects a device. */
  readonly look: (device: string) => void;
}

/** Missing in a DOM without layout: a size for everything, reported to observers, and canvases that accept any drawing. */
const [WIDTH, HEIGHT] = [1000, 150];

class SizeObserver {
  readonly #changed: () => void;
  #isOver = false;

  constructor(changed: () => void) {
    this.#changed = changed;
  }

  observe(): void {
    queueMicrotask(() => this.#isOver || this.#changed());
  }

  disconnect(): void {
    this.#isOver = true;
  }
}

export function giveSizes(): void {
  const nothing: unknown = new Proxy(() => {}, {
    get: (_, name) => (name === Symbol.toPrimitive ? () => 0 : name === "width" ? 10 : nothing),
    apply: () => nothing,
    set: () => true,
  });
  vi.stubGlobal("ResizeObserver", SizeObserver);
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(() => nothing as never);
  vi.spyOn(HTMLElement.prototype, "clientWidth", "get").mockReturnValue(WIDTH);
  vi.spyOn(HTMLElement.prototype, "clientHeight", "get").mockReturnValue(HEIGHT);
  vi.spyOn(HTMLElement.prototype, "getBoundingClientRect").mockReturnValue(new DOMRect(0, 0, WIDTH, HEIGHT));
}

/** A page over a store of its own, until the test is over. */
export function newApp(store = new Store()): App {
  const app = startApp({ store, viewState: createViewState(), recentHealth: new RecentHealth() });
  running.push(app.stop);
  return app;
}

/** Ends the pages that run. */
const running: (() => void)[] = [];

function end(): void {
  cleanup();
  for (const stop of running.splice(0)) stop();
}
afterEach(end); // effects that wait for a frame do not outlive the test

/** Ends the pages that run, and goes to an address. */
export function startOver(place: string): void {
  end();
  location.hash = place;
  route.value = parse(place) ?? route.value;
}

export async function openPage(
  known: Pick<Recorded, "texts" | "samples" | "answers">,
  { place = "#/", answers = {} }: { readonly place?: string; readonly answers?: Answers } = {},
): Promise<Opened> {
  startOver(place);
  vi.restoreAllMocks();
  giveSizes();
  const asked = answering({ ...known.answers, ...answers });
  const app = newApp();
  const { store } = app;
  running.push(startKeyboard(app));
  feed(store, known, known.texts);
  render(<Shell app={app} />);
  const { view } = app.viewState;
  return { store, app, asked, look: (device) => void (view.value = { ...view.peek(), device }) };
}

startRoute();
