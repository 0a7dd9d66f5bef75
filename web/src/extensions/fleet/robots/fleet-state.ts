/** What the page of a fleet knows and shows: its robots, asked for each second, and their order on screen. */
import { batch, computed, signal } from "@preact/signals";
import { perApp } from "../../../page/app-state";
import type { App } from "../../../page/context";
import { route } from "../../../page/route";
import { isRefusal, type HttpProblem, request } from "../../../requests/http";
import { type FleetPlace, fleetHref, readRobotPlace, START } from "./address";
import { columnNamed, type RobotColumn } from "./columns";
import { arrange, countAll, type RobotGroup, isSameOrder, robotLines } from "./order";
import { Robots } from "./robots";

/** Pause between two requests, ms; longer while the page is hidden. */
const ASK_MS = 1000;
const HIDDEN_MS = 10_000;
/** Failed requests after which the server counts as away. */
const MAX_FAILURES = 2;
/** The list takes a new order at most this often, ms. */
export const ORDER_MS = 5000;
/** A list that was scrolled, or moved through with keys, keeps its order for this long, ms. */
export const REST_MS = 3000;

export class Fleet {
  readonly robots = new Robots();
  /** Grows with each answer. */
  readonly version = signal(0);
  readonly place = signal<FleetPlace>(START);
  /** Whether the first answer is here. */
  readonly isKnown = signal(false);
  readonly problem = signal<HttpProblem | undefined>(undefined);
  /** Whether the server has not answered several times, or refuses: a single request may fail. */
  readonly isCut = signal(false);
  /** Time of the newest answer, s: that of the server, and of performance.now(). */
  readonly answered = signal({ server: 0, here: 0 });
  /** Names in the order shown. */
  readonly groups = signal<readonly RobotGroup[]>([]);
  /** Whether the robots have changed so that another order would be right. */
  readonly isOutOfOrder = signal(false);
  readonly folded = signal<ReadonlySet<string>>(new Set());
  readonly expanded = signal<ReadonlySet<string>>(new Set());
  /** Name of the robot that keys act on. */
  readonly active = signal<string | undefined>(undefined);
  readonly counts = computed(() => {
    void this.version.value;
    return countAll(this.robots.all.values());
  });
  readonly lines = computed(() => {
    const expanded = this.expanded.value;
    const devicesOf = (name: string): number =>
      expanded.has(name) ? (this.robots.get(name)?.summary.devices.length ?? 0) : 0;
    if (expanded.size > 0) void this.version.value;
    return robotLines(this.groups.value, this.place.value, this.folded.value, devicesOf);
  });
  #failed = 0;
  #ordered = 0;
  #pointerOver = false;
  #restsUntil = 0;
  #retry: (() => void) | undefined;

  /** Unix s of the server, now. */
  now(): number {
    const { server, here } = this.answered.value;
    return server + (performance.now() / 1000 - here);
  }

  /** Asks for robots until the returned function is called. */
  follow(): () => void {
    let isOver = false;
    const cancel = new AbortController();
    const run = async (): Promise<void> => {
      while (!isOver) {
        await this.#ask(cancel.signal);
        if (isOver) return;
        await new Promise<void>((resolve) => {
          const timer = setTimeout(resolve, document.hidden ? HIDDEN_MS : ASK_MS);
          this.#retry = () => {
            clearTimeout(timer);
            resolve();
          };
        });
      }
    };
    const wake = (): void => {
      if (!document.hidden) this.retry();
    };
    document.addEventListener("visibilitychange", wake);
    void run();
    return () => {
      isOver = true;
      cancel.abort();
      document.removeEventListener("visibilitychange", wake);
      this.retry();
    };
  }

  /** Asks now. */
  retry(): void {
    this.#retry?.();
  }

  async #ask(signal: AbortSignal): Promise<void> {
    // after a failure the server may be another one: then everything is asked for
    const after = this.problem.peek() === undefined ? this.robots.revision : undefined;
    let outcome = await request("GET /api/fleet/robots", { query: { after }, signal });
    let isApplied = outcome.ok && this.#accept(outcome.value, after);
    if (outcome.ok && !isApplied) {
      outcome = await request("GET /api/fleet/robots", { query: {}, signal });
      isApplied = outcome.ok && this.#accept(outcome.value, undefined);
    }
    if (signal.aborted) return;
    this.#failed = outcome.ok ? 0 : this.#failed + 1;
    batch(() => {
      this.problem.value = outcome.ok ? undefined : outcome.problem;
      this.isCut.value = this.#failed >= MAX_FAILURES || this.isRefused;
    });
  }

  #accept(answer: Parameters<Robots["apply"]>[0], after: number | undefined): boolean {
    if (!this.robots.apply(answer, after)) return false;
    batch(() => {
      this.answered.value = { server: answer.time, here: performance.now() / 1000 };
      this.version.value += 1;
      this.#maybeSort(!this.isKnown.peek());
      this.isKnown.value = true;
    });
    return true;
  }

  get isRefused(): boolean {
    const problem = this.problem.value;
    return problem !== undefined && isRefusal(problem);
  }

  /** A row must not move away from a pointer: while it is over the rows they keep their order. */
  pointer(isOver: boolean): void {
    this.#pointerOver = isOver;
  }

  /** The list was scrolled or moved through: it keeps its order for some seconds. */
  disturb(): void {
    this.#restsUntil = performance.now() + REST_MS;
  }

  #maybeSort(isFirst: boolean): void {
    const next = arrange(this.robots.all.values(), this.place.peek());
    const now = performance.now();
    if (isSameOrder(next, this.groups.peek())) {
      this.isOutOfOrder.value = false;
      this.#ordered = now;
      return;
    }
    if (!isFirst && now < this.#ordered + ORDER_MS) return;
    if (!isFirst && (this.#pointerOver || now < this.#restsUntil)) this.isOutOfOrder.value = true;
    else this.sortNow();
  }

  /** Brings the rows into order, wherever the pointer is. */
  sortNow(): void {
    batch(() => {
      this.robots.gone.clear();
      this.groups.value = arrange(this.robots.all.values(), this.place.peek());
      this.isOutOfOrder.value = false;
    });
    this.#ordered = performance.now();
  }

  /** Shows another choice of robots, at once. */
  choose(part: Partial<FleetPlace>): void {
    batch(() => {
      this.place.value = { ...this.place.peek(), ...part };
      this.sortNow();
    });
    this.#write(false);
  }

  sortBy(name: RobotColumn): void {
    const { sort, descending } = this.place.peek();
    this.choose({ sort: name, descending: sort === name ? !descending : (columnNamed(name)?.largestFirst ?? true) });
  }

  /** Opens the details of a robot; Back closes them again. */
  open(robot: string): void {
    const wasOpen = this.place.peek().robot !== "";
    this.active.value = robot || this.active.peek();
    this.place.value = { ...this.place.peek(), robot };
    this.#write(robot !== "" && !wasOpen);
  }

  toggleFold(title: string): void {
    this.folded.value = toggled(this.folded.peek(), title);
  }

  toggleDevices(name: string): void {
    this.expanded.value = toggled(this.expanded.peek(), name);
  }

  #write(isStep: boolean): void {
    const address = fleetHref(this.place.peek());
    if (location.hash === address) return;
    if (isStep) history.pushState(null, "", address);
    else history.replaceState(null, "", address);
  }

  /** Follows links and Back; the bare address shows what was shown last. */
  followAddress(): () => void {
    return route.subscribe(({ page, query }) => {
      if (page !== "fleet") return;
      if (!location.hash.includes("?") && fleetHref({ ...this.place.peek(), robot: "" }) !== "#/fleet") {
        this.place.value = { ...this.place.peek(), robot: "" };
        this.#write(false);
        return;
      }
      const place = readRobotPlace(query ?? "");
      batch(() => {
        this.place.value = place;
        this.sortNow();
      });
    });
  }
}

function toggled(all: ReadonlySet<string>, one: string): ReadonlySet<string> {
  const next = new Set(all);
  if (!next.delete(one)) next.add(one);
  return next;
}

export const fleetOf: (app: App) => Fleet = perApp(() => new Fleet());
