/** What the page's components share beyond the store: which sheet is open, the last problem, ports heard, a slow clock. */
import { computed, effect, signal } from "@preact/signals";
import { frame, view } from "../data/view-state";
import type { Begin } from "../forms/add-device";
import type { Deps } from "../panels/panel-context";
import { api, type Outcome, type Port, type Problem } from "../ui/http";
import { isHeld, type PageState, pageState } from "../ui/page-state";
import type { DeviceInfo, RawPayload } from "../wire/types";
import { route } from "./route";

export type Overlay = "help" | "add" | "track" | "describe" | undefined;
/** The device whose reading is changed. */
export const keyFor = signal<Begin | undefined>(undefined);
/** The payload that is being described. */
export const describing = signal<RawPayload | undefined>(undefined);
/** A panel that lies over the plots while the window is narrow. */
export type Sheet = "rail" | "side" | undefined;

export const overlay = signal<Overlay>(undefined);
export const sheet = signal<Sheet>(undefined);
/** The side panel folded away on a wide window. */
export const folded = signal(false);
/** The last request that failed; stays until dismissed. */
export const problem = signal<Problem | undefined>(undefined);
export const ports = signal<readonly Port[]>([]);
export const scanning = signal(false);
/** Counts half seconds: components that show an age or a countdown read it. */
export const tick = signal(0);

export interface App extends Deps {
  readonly device: { readonly value: DeviceInfo | undefined };
  readonly state: { readonly value: PageState };
  readonly held: () => boolean;
}

/** Derives the page's state from the store, keeps a device selected, and feeds the minute behind the sparklines. */
export function startApp(deps: Deps): App {
  const { store, minute } = deps;
  const device = computed(() => store.devices.value.find(({ id }) => id === view.value.device));
  // A ring tells by itself whether it holds anything; the slow clock asks again.
  const seen = computed(() => {
    void tick.value;
    const id = view.value.device;
    return store.channels.value.some(({ info, ring }) => info.device === id && ring.length > 0);
  });
  // Without a connection what is on screen stays; only a page that never had one is starting.
  const greeted = computed(() => store.connection.value === "open" || store.devices.value.length > 0);
  const state = computed(() => pageState(greeted.value, store.devices.value.length, device.value, seen.value));
  effect(() => {
    for (const health of store.health.value.values()) minute.add(health);
  });
  effect(() => store.showIn(frame.value));
  effect(() => {
    const id = awaited.value;
    if (id === undefined || !store.devices.value.some((one) => one.id === id)) return;
    awaited.value = undefined;
    view.value = { ...view.peek(), device: id };
  });
  effect(() => {
    if (route.value.recording !== undefined) return; // its devices are others
    const [first] = store.devices.value;
    const chosen = device.value;
    if (!chosen && first) view.value = { ...view.peek(), device: first.id };
  });
  effect(() => {
    const name = device.value?.name;
    if (route.value.page !== "live") return; // that page names itself
    const word = state.value === "lost" ? "Lost" : "Live";
    document.title = [word, name, "imuscope"].filter(Boolean).join(" · ");
  });
  setInterval(() => {
    tick.value += 1;
  }, 500);
  const held = (): boolean => isHeld(state.value) || store.isCut;
  return { ...deps, device, state, held };
}

/** A device that was asked for; one that was just added is looked at as soon as the server tells of it. */
const awaited = signal<string | undefined>(undefined);

export function select(id: string): void {
  awaited.value = id;
  sheet.value = undefined;
}

/** Shows what went wrong with a request, if anything did. */
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

/** Asks for the key of a device that is open: it is used from there on. All devices of a link have one key. */
export function askKey(device: DeviceInfo): void {
  const { source, protocol, time_unit, rotation } = device;
  keyFor.value = { id: linkOf(device), source, protocol, time_unit, rotation };
  overlay.value = "add";
}

/** The id under which the link of a device is retried, read in another way and removed. */
export function linkOf(device: DeviceInfo): string {
  return device.parent || device.id;
}

/** Adds a device and looks at it. */
export async function connect(source: string): Promise<void> {
  const added = await run(api.addDevice(source));
  if (added?.id !== undefined) select(added.id);
  void loadPorts();
}
