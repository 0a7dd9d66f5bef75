/** The entries of the log of a device: those that arrived, and older ones as far as they were loaded. */
import { computed, effect, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import { madeFor } from "../../page/app-state";
import type { Model } from "../../pages/configure/model";
import { request } from "../../requests/http";
import type { TrafficEntry } from "../../wire/types";

/** Entries that are loaded at once. */
const OLDER_BY = 200;

class TrafficState {
  readonly #older: Signal<readonly TrafficEntry[]> = signal([]);
  readonly noOlder = signal(false);
  readonly entries: ReadonlySignal<readonly TrafficEntry[]>;

  constructor(readonly model: Model) {
    const { id, store } = model;
    this.entries = computed(() => {
      const own = store.traffic.value.filter(({ device }) => device === id);
      const known = new Set(own.map(({ seq }) => seq)); // entries missed while disconnected lie between them
      return [...this.#older.value.filter(({ seq }) => !known.has(seq)), ...own].sort((a, b) => a.seq - b.seq);
    });
    // another sensor on this link has a log of its own
    const sensor = computed(() => (model.device.value?.serial_number ? model.device.value.key : ""));
    let before = sensor.peek();
    effect(() => {
      if (sensor.value === "") return;
      if (before !== "" && sensor.value !== before) this.#forget();
      before = sensor.value;
    });
    effect(() => {
      if (store.jobs.value.size === 0) this.#forget(); // another run of the server numbers entries anew
    });
    effect(() => {
      if (model.loads.value > 0) void this.loadOlder(undefined);
    });
  }

  #forget(): void {
    this.#older.value = [];
    this.noOlder.value = false;
  }

  async loadOlder(before = this.entries.peek()[0]?.seq): Promise<void> {
    const query = { before, limit: OLDER_BY };
    const found = await request("GET /api/devices/{device}/traffic", { path: { device: this.model.id }, query });
    if (!found.ok) return;
    this.noOlder.value = found.value.length < OLDER_BY;
    const known = new Set(this.#older.peek().map(({ seq }) => seq));
    this.#older.value = [...found.value.filter(({ seq }) => !known.has(seq)), ...this.#older.peek()].sort(
      (a, b) => a.seq - b.seq,
    );
  }
}

export const logOf = madeFor((model: Model) => new TrafficState(model));
