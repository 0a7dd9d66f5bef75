/**
 * State of the page beyond the store: the open dialog, the last problem, ports, a slow clock. `startApp` makes it, and every component
 * gets it as a property, so that a document can hold several pages that know nothing of each other.
 */
import type { Overlay, App, Deps, Sort } from "./context";
import { computed, effect, signal } from "@preact/signals";
import { allExtensions } from "../extension/extension";
import { api, type Outcome } from "../requests/http";
import { isHeld, pageState } from "./page-state";
import { deviceInLink, shortName } from "../wire/device-name";
import type { DeviceInfo } from "../wire/types";
import { route } from "./route";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/live";

/** State that belongs to an object: one for each, made when it is first used. */
export function madeFor<Owner extends object, T>(make: (owner: Owner) => T): (owner: Owner) => T {
  const made = new WeakMap<Owner, { readonly state: T }>();
  return (owner) => {
    const found = made.get(owner) ?? { state: make(owner) };
    made.set(owner, found);
    return found.state;
  };
}

/** State of a part of the page: one for each page. It outlives a change to another part. */
export const perApp = <T>(make: (app: App) => T): ((app: App) => T) => madeFor(make);

/** The plots on screen, if they are not those of Live. */
export const shownPlots = perApp(() => signal<Deps | undefined>(undefined));

/** Derives the page's state from the store, keeps a device selected, and feeds the minute behind the sparklines. */
export function startApp(deps: Omit<Deps, "open" | "held" | "eventSort">): App {
  const { store, recentHealth } = deps;
  const [tick, awaited] = [signal(0), signal<string | undefined>(undefined)];
  const overlay = signal<Overlay>(undefined);
  const openTable: App["openTable"] = signal(undefined);
  const keyFor: App["keyFor"] = signal(undefined);
  const subject: App["subject"] = signal(undefined);
  const packetAt: App["packetAt"] = signal(undefined);
  const showsSignals = signal(false);
  const linked = signal<string | undefined>(undefined);
  const { view, frame, device: selected } = deps.viewState;
  const device = computed(() => store.devices.value.find(({ id }) => id === selected.value));
  // a ring does not signal whether it holds anything; the slow clock checks again
  const seen = computed(() => {
    void tick.value;
    const id = selected.value;
    return store.channels.value.some(({ info, ring }) => info.device === id && ring.length > 0);
  });
  // without a connection the display stays; only a page that never had one is starting
  const isConnected = computed(() => store.connection.value === "open" || store.devices.value.length > 0);
  const state = computed(() => pageState(isConnected.value, store.devices.value.length, device.value, seen.value));
  const stops = [
    effect(() => {
      const ended = new Set(store.devices.peek().flatMap(({ id, status }) => (status === "ended" ? [id] : [])));
      // after its end a file has no further minute: the last one stays
      for (const health of store.health.value.values()) if (!ended.has(health.device)) recentHealth.add(health);
    }),
    effect(() => store.showIn(frame.value)),
    effect(() => {
      const id = awaited.value;
      if (id === undefined || !store.devices.value.some((one) => one.id === id)) return;
      awaited.value = undefined;
      view.value = { ...view.peek(), device: id };
    }),
    effect(() => {
      const found = linked.value === undefined ? undefined : deviceInLink(linked.value, store.devices.value);
      if (found === undefined) return;
      linked.value = undefined;
      if (view.peek().device !== found.id) view.value = { ...view.peek(), device: found.id };
    }),
    effect(() => {
      const [first] = store.devices.value;
      if (device.value || !first) return;
      const [gone = "", link] = [view.peek().device, view.peek().device?.split(".")[0]];
      // a server that was started again knows the further devices of a link once they have sent something
      if (gone !== link && store.devices.value.some(({ id }) => id === link)) awaited.value = gone;
      view.value = { ...view.peek(), device: awaited.peek() === gone && link ? link : first.id };
    }),
    effect(() => {
      const name = device.value && shortName(device.value);
      if (route.value.page !== "live") return; // that page sets its own title
      const word = state.value === "lost" ? COMMON.lost : TEXT.live;
      document.title = [word, name, "imuscope"].filter(Boolean).join(" · ");
    }),
  ];
  const place = computed(() => `${route.value.page} ${route.value.recording ?? ""}`);
  // a dialog stays on its page
  stops.push(effect(() => void (place.value && (overlay.value = keyFor.value = undefined))));
  const timer = setInterval(() => {
    tick.value += 1;
  }, 500);
  const stop = (): void => {
    clearInterval(timer);
    for (const end of stops) end();
  };
  const behind = (): number => store.behind(selected.value ?? "").total;
  const held = (): boolean => isHeld(state.value) || store.isCut || behind() > 0;
  return {
    ...deps,
    open: {
      signals: () => (showsSignals.value = true),
      rows: (name, title) => (openTable.value = { name, title }),
      packet(at) {
        packetAt.value = at;
        overlay.value = "packet";
      },
      dialog(name, about) {
        subject.value = about;
        overlay.value = name;
      },
    },
    device,
    state,
    held,
    stop,
    overlay,
    openTable,
    subject,
    packetAt,
    tick,
    awaited,
    linked,
    eventSort: signal<Sort>("all"),
    keyFor,
    newAddress: signal(""),
    sheet: signal(undefined),
    showsSignals,
    folded: signal(false),
    problem: signal(undefined),
    refusal: signal(undefined),
    ports: signal([]),
    scanning: signal(false),
  };
}

export function startExtensions(app: App): void {
  for (const { start } of allExtensions()) start?.(app);
}

export function select(app: App, id: string): void {
  app.awaited.value = id;
  app.linked.value = undefined;
  app.sheet.value = undefined;
}

/** Shows the problem of a request, if any. */
export async function run<T>(app: App, request: Promise<Outcome<T>>): Promise<T | undefined> {
  const outcome = await request;
  app.problem.value = outcome.ok ? undefined : outcome.problem;
  return outcome.ok ? outcome.value : undefined;
}

export async function loadPorts(app: App): Promise<void> {
  const outcome = await api.ports();
  if (outcome.ok) app.ports.value = outcome.value;
}

/** Listens on every free port; takes some seconds. */
export async function scanPorts(app: App): Promise<void> {
  if (app.scanning.value) return;
  app.scanning.value = true;
  const found = await run(app, api.scanPorts());
  if (found) app.ports.value = found;
  app.scanning.value = false;
}

/** Asks for the key of an open device, used from then on. All devices of a link have one key. */
export function askKey(app: App, device: DeviceInfo): void {
  const { source, protocol, decode_options: options } = device;
  app.keyFor.value = { id: linkOf(device), source, protocol, options };
  app.overlay.value = "add";
}

/** The id by which the link of a device is retried, reconfigured and removed. */
export function linkOf(device: DeviceInfo): string {
  return device.parent || device.id;
}

/** Adds a device and selects it. */
export async function connect(app: App, source: string): Promise<void> {
  const added = await run(app, api.addDevice(source));
  if (added?.id !== undefined) select(app, added.id);
  void loadPorts(app);
}
