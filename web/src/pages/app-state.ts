/** State shared by the page's components beyond the store: the open dialog, the last problem, ports, a slow clock. */
import { computed, effect, signal } from "@preact/signals";
import type { Begin } from "../forms/add-device";
import type { Deps, Openers } from "../panels/panel-context";
import { api, type Outcome, type Port, type Problem } from "../ui/http";
import { isHeld, type PageState, pageState } from "../ui/page-state";
import type { DeviceInfo, UnknownPayload } from "../wire/types";
import { route } from "./route";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

export type Overlay = "help" | "add" | "track" | "describe" | undefined;
/** The device whose decoding is being changed. */
export const keyFor = signal<Begin | undefined>(undefined);
/** The table being shown: name and title of its channel. */
export const openTable = signal<{ readonly name: string; readonly title: string } | undefined>(undefined);
/** The payload that is being described. */
export const describing = signal<UnknownPayload | undefined>(undefined);
/** A panel over the plots while the window is narrow. */
export type Drawer = "rail" | "side" | undefined;

export const overlay = signal<Overlay>(undefined);
export const sheet = signal<Drawer>(undefined);
/** Whether the side panel is folded on a wide window. */
export const folded = signal(false);
/** The last request that failed; stays until dismissed. */
export const problem = signal<Problem | undefined>(undefined);
export const ports = signal<readonly Port[]>([]);
export const scanning = signal(false);
/** Counts half seconds, for components that show an age or a countdown. */
export const tick = signal(0);

export interface App extends Deps {
  readonly device: { readonly value: DeviceInfo | undefined };
  readonly state: { readonly value: PageState };
}

/** Overlays that panels can open, on Live and over a recording. */
export const OPENERS: Openers = {
  track: () => (overlay.value = "track"),
  rows: (name, title) => (openTable.value = { name, title }),
  describe(payload) {
    describing.value = payload;
    overlay.value = "describe";
  },
};

/** Derives the page's state from the store, keeps a device selected, and feeds the minute behind the sparklines. */
export function startApp(deps: Omit<Deps, "open" | "held">): App {
  const { store, recentHealth } = deps;
  const { view, frame } = deps.viewState;
  const device = computed(() => store.devices.value.find(({ id }) => id === view.value.device));
  // a ring does not signal whether it holds anything; the slow clock checks again
  const seen = computed(() => {
    void tick.value;
    const id = view.value.device;
    return store.channels.value.some(({ info, ring }) => info.device === id && ring.length > 0);
  });
  // without a connection the display stays; only a page that never had one is starting
  const greeted = computed(() => store.connection.value === "open" || store.devices.value.length > 0);
  const state = computed(() => pageState(greeted.value, store.devices.value.length, device.value, seen.value));
  effect(() => {
    for (const health of store.health.value.values()) recentHealth.add(health);
  });
  effect(() => store.showIn(frame.value));
  effect(() => {
    const id = awaited.value;
    if (id === undefined || !store.devices.value.some((one) => one.id === id)) return;
    awaited.value = undefined;
    view.value = { ...view.peek(), device: id };
  });
  effect(() => {
    const [first] = store.devices.value;
    const chosen = device.value;
    if (!chosen && first) view.value = { ...view.peek(), device: first.id };
  });
  effect(() => {
    const name = device.value?.name;
    if (route.value.page !== "live") return; // that page sets its own title
    const word = state.value === "lost" ? COMMON.lost : TEXT.live;
    document.title = [word, name, "imuscope"].filter(Boolean).join(" · ");
  });
  setInterval(() => {
    tick.value += 1;
  }, 500);
  const held = (): boolean => isHeld(state.value) || store.isCut;
  return { ...deps, open: OPENERS, device, state, held };
}

/** A requested device; a newly added one is selected as soon as the server reports it. */
const awaited = signal<string | undefined>(undefined);

export function select(id: string): void {
  awaited.value = id;
  sheet.value = undefined;
}

/** Shows the problem of a request, if any. */
export async function run<T>(request: Promise<Outcome<T>>): Promise<T | undefined> {
  const outcome = await request;
  problem.value = outcome.ok ? undefined : outcome.problem;
  return outcome.ok ? outcome.value : undefined;
}

export async function loadPorts(): Promise<void> {
  const outcome = await api.ports();
  if (outcome.ok) ports.value = outcome.value;
}

/** Listens on every free port; takes some seconds. */
export async function scanPorts(): Promise<void> {
  if (scanning.value) return;
  scanning.value = true;
  const found = await run(api.scanPorts());
  if (found) ports.value = found;
  scanning.value = false;
}

/** Asks for the key of an open device, used from then on. All devices of a link have one key. */
export function askKey(device: DeviceInfo): void {
  const { source, protocol, time_unit, rotation } = device;
  keyFor.value = { id: linkOf(device), source, protocol, options: { time_unit, rotation } };
  overlay.value = "add";
}

/** The id by which the link of a device is retried, reconfigured and removed. */
export function linkOf(device: DeviceInfo): string {
  return device.parent || device.id;
}

/** Adds a device and selects it. */
export async function connect(source: string): Promise<void> {
  const added = await run(api.addDevice(source));
  if (added?.id !== undefined) select(added.id);
  void loadPorts();
}
