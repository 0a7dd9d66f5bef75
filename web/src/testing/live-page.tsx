/** The whole page as just opened, from a recorded server, in a DOM without a browser. */
import { cleanup, render } from "@testing-library/preact";
import { afterEach, vi } from "vitest";
import type { Store } from "../data/store";
import type { App } from "../pages/app-state";
import { answering, type Answers, type Asked, feed, type Recorded } from "./recorded";

export interface Opened {
  readonly store: Store;
  readonly app: App;
  /** Every request so far. */
  readonly asked: readonly Asked[];
  /** Selects a device. */
  readonly look: (device: string) => void;
}

/** Missing in a DOM without layout: a size for everything, and canvases that accept any drawing. */
const [WIDTH, HEIGHT] = [1000, 150];

function giveSizes(): void {
  const nothing: unknown = new Proxy(() => {}, {
    get: (_, name) => (name === Symbol.toPrimitive ? () => 0 : name === "width" ? 10 : nothing),
    apply: () => nothing,
    set: () => true,
  });
  vi.spyOn(HTMLCanvasElement.prototype, "getContext").mockImplementation(() => nothing as never);
  vi.spyOn(HTMLElement.prototype, "clientWidth", "get").mockReturnValue(WIDTH);
  vi.spyOn(HTMLElement.prototype, "clientHeight", "get").mockReturnValue(HEIGHT);
  vi.spyOn(HTMLElement.prototype, "getBoundingClientRect").mockReturnValue(new DOMRect(0, 0, WIDTH, HEIGHT));
}

afterEach(cleanup); // effects that wait for a frame do not outlive the test

/** Opens the page, without module state of an earlier one. */
export async function openPage(
  known: Pick<Recorded, "texts" | "samples" | "answers">,
  { place = "#/", answers = {} }: { readonly place?: string; readonly answers?: Answers } = {},
): Promise<Opened> {
  cleanup();
  vi.resetModules();
  vi.restoreAllMocks();
  giveSizes();
  const asked = answering({ ...known.answers, ...answers });
  location.hash = place;
  const { startApp } = await import("../pages/app-state");
  const { startRoute } = await import("../pages/route");
  const { startKeyboard } = await import("../pages/keyboard");
  const { createViewState } = await import("../data/view-state");
  const { RecentHealth } = await import("../panels/health-history");
  const { Store: RealStore } = await import("../data/store");
  const { Shell } = await import("../pages/shell");
  const store = new RealStore();
  const app = startApp({ store, viewState: createViewState(), recentHealth: new RecentHealth() });
  startRoute();
  stopKeys();
  stopKeys = startKeyboard(app);
  feed(store, known, known.texts);
  render(<Shell app={app} />);
  const { view } = app.viewState;
  return { store, app, asked, look: (device) => void (view.value = { ...view.peek(), device }) };
}

/** Keys of an earlier page. */
let stopKeys = (): void => undefined;
