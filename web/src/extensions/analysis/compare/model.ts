/** State of one comparison page: the place, what the sources hold, and the server's last answer. */
import { computed, type ReadonlySignal, type Signal, signal } from "@preact/signals";
import { signalNames } from "../figures";
import { likeNames } from "../proposals";
import type { Channel } from "../../../data/channels";
import { isOpening, recordingsApi } from "../../../recordings/api";
import { distinctNames } from "../../../recordings/library-filter";
import { listName } from "../../../wire/device-name";
import type { RecordingDetail, RecordingInfo } from "../../../wire/recording-types";
import { type HttpProblem, request } from "../../../requests/http";
import { LatestAnswer, type Shown } from "../../../requests/latest-answer";
import type { ComparedSide, ComparisonAnswer, ComparisonRequest } from "../../../wire/routes";
import type { App } from "../../../page/context";
import { type ComparePlace, likelyOther, readComparison, requestedSide, type SideChoice } from "./sides";

/** Polling interval while a recording is decoded for the first time, ms. */
const OPENING_MS = 400;

/** A moment of a source at which both may be aligned. */
interface Moment {
  readonly time: number;
  readonly text: string;
}

export type Ready = ComparePlace & { readonly b: SideChoice };

export interface CompareModel {
  readonly app: App;
  readonly place: Signal<ComparePlace>;
  readonly recordings: Signal<readonly RecordingInfo[] | undefined>;
  readonly details: Signal<ReadonlyMap<string, RecordingDetail>>;
  readonly latest: LatestAnswer<ComparisonAnswer>;
  /** The result of the place, or why there is none. */
  readonly shown: ReadonlySignal<Shown<ComparisonAnswer>>;
  /** Why a source is missing, or no offset could be found. */
  readonly problem: Signal<HttpProblem | undefined>;
  readonly correlating: Signal<boolean>;
  /** Of the offset, while it is the one that was correlated. */
  readonly aligned: Signal<ComparisonAnswer | undefined>;
  /** s that B is being dragged by. */
  readonly dragged: Signal<number>;
  /** Place with a B, once the sources are known. */
  readonly ready: ReadonlySignal<Ready | undefined>;
}

export function compareModel(app: App, query: string): CompareModel {
  const place = signal(readComparison(query));
  const recordings: CompareModel["recordings"] = signal(undefined);
  const details: CompareModel["details"] = signal(new Map());
  const ready = computed(() => {
    const { a, b, ...rest } = place.value;
    const known = recordings.value;
    if (b === undefined && known === undefined) return undefined;
    const product = productOf(app, details.value, a);
    const other = b ?? likelyOther(a, product, app.store.devices.value, known ?? []);
    const sides = { a: withDevice(a, details.value), b: withDevice(other, details.value) };
    const isKnown = [sides.a, sides.b].every(({ source }) => isLive(app, source) || details.value.has(source));
    if (!isKnown) return undefined;
    return { ...rest, ...sides, ...(rest.signal ? {} : likelySignals(app, details.value, sides)) };
  });
  const latest = new LatestAnswer<ComparisonAnswer>();
  return {
    app,
    place,
    recordings,
    details,
    ready,
    latest,
    shown: computed(() => latest.of(JSON.stringify(ready.value))),
    problem: signal(undefined),
    correlating: signal(false),
    aligned: signal(undefined),
    dragged: signal(0),
  };
}

export const isLive = (app: App, source: string): boolean => app.store.devices.value.some(({ id }) => id === source);

function productOf(app: App, details: ReadonlyMap<string, RecordingDetail>, { source, device }: SideChoice): string {
  const live = app.store.devices.value.find(({ id }) => id === source);
  const recorded = details.get(source)?.devices;
  return (live ?? recorded?.find(({ id }) => id === device) ?? recorded?.[0])?.product ?? "";
}

/** The side with a device, if its recording has several. */
function withDevice(side: SideChoice, details: ReadonlyMap<string, RecordingDetail>): SideChoice {
  const devices = details.get(side.source)?.devices ?? [];
  if (devices.length < 2 || devices.some(({ id }) => id === side.device)) return side;
  return { ...side, device: devices[0]?.id ?? "" };
}

/** Sources of the place that are neither in the library nor a live device, once both are known. */
export function unknownSources({ app, place, recordings }: CompareModel): readonly string[] {
  const known = recordings.value;
  if (known === undefined || app.store.connection.value !== "open") return [];
  const { a, b } = place.value;
  return [a.source, b?.source ?? a.source].filter(
    (source, i, all) => !isLive(app, source) && !known.some(({ id }) => id === source) && all.indexOf(source) === i,
  );
}

/** Signals of a side that can be compared, the most wanted one first. */
export function comparedNames(
  app: App,
  details: ReadonlyMap<string, RecordingDetail>,
  { source, device }: SideChoice,
): readonly string[] {
  if (isLive(app, source)) return signalNames(app.store.channels.value, source);
  const detail = details.get(source);
  const own = device || detail?.devices[0]?.id;
  return signalNames(detail?.channels.map((info) => ({ info }) as Channel) ?? [], own);
}

/** The most wanted signal of A, and of B another one if that is called otherwise there. */
function likelySignals(
  app: App,
  details: ReadonlyMap<string, RecordingDetail>,
  { a, b }: { readonly a: SideChoice; readonly b: SideChoice },
): Pick<ComparePlace, "signal" | "signalB"> {
  const [own, others] = [comparedNames(app, details, a), comparedNames(app, details, b)];
  const [first = ""] = own;
  return { signal: first, signalB: others.includes(first) ? "" : (others[0] ?? "") };
}

/** The side without the compared signal, and what it has instead. */
export function missingSide({ app, details }: CompareModel, { a, b, signal: name }: Ready) {
  const channelsOf = ({ source, device }: SideChoice): readonly Channel[] => {
    if (isLive(app, source)) return app.store.channels.value.filter(({ info }) => info.device === source);
    const { channels = [], devices = [] } = details.value.get(source) ?? {};
    const own = device || devices[0]?.id;
    return channels.filter((info) => info.device === own).map((info) => ({ info }) as Channel);
  };
  const has = channelsOf(a).some(({ info }) => name === info.name || name.startsWith(`${info.name}.`));
  const [side, lacking, other] = has ? (["b", b, a] as const) : (["a", a, b] as const);
  const mark = ({ info }: Channel): Channel => ({ info: { ...info, device: "" } }) as Channel; // ids of both may be the same
  const own = channelsOf(lacking);
  return { side, names: likeNames([name], own[0]?.info.device, [...channelsOf(other).map(mark), ...own]) };
}

/** Name of a source. */
export function sourceTitle(app: App, recordings: readonly RecordingInfo[] | undefined, source: string): string {
  const live = app.store.devices.value.find(({ id }) => id === source);
  const recording = recordings?.find(({ id }) => id === source);
  if (live) return listName(live);
  if (recording === undefined) return source;
  return distinctNames(recordings ?? []).get(recording) ?? source;
}

/** Begin and end of what a side can show, unix s. */
export function boundsOf(model: CompareModel, { source, last }: SideChoice): readonly [number, number] {
  const detail = model.details.value.get(source);
  const now = model.app.store.edgeOf(source);
  return detail ? [detail.t0, detail.t1] : [now - (last ?? 0), now];
}

/** Markers and events of a side, in order of time. */
export function momentsOf(model: CompareModel, side: SideChoice): readonly Moment[] {
  const detail = model.details.value.get(side.source);
  const events = detail?.events ?? model.app.store.events.value;
  const own = side.device || (detail ? "" : side.source);
  const named = events.filter(({ device }) => own === "" || device === own).map(({ time, text }) => ({ time, text }));
  const markers = detail?.markers.map(({ time, text }) => ({ time, text })) ?? [];
  return [...markers, ...named].sort((x, y) => x.time - y.time).slice(-200);
}

/** Loads what the place needs: the library, and the details of its recordings. Returns what ends it. */
export function loadSources(model: CompareModel): () => void {
  const { app, place, recordings, details, problem } = model;
  let over = false;
  const asked = new Set<string>();
  const load = async (id: string): Promise<void> => {
    const outcome = await recordingsApi.detail(id);
    if (over) return;
    if (!outcome.ok) {
      asked.delete(id);
      problem.value = outcome.problem;
      return;
    }
    if (isOpening(outcome.value) || outcome.value.progress < 1) setTimeout(() => !over && void load(id), OPENING_MS);
    else details.value = new Map(details.peek()).set(id, outcome.value);
  };
  const want = (source: string | undefined): void => {
    if (!source || asked.has(source) || isLive(app, source)) return;
    asked.add(source);
    void load(source);
  };
  let missed: HttpProblem | undefined;
  const list = async (): Promise<void> => {
    const outcome = await recordingsApi.list();
    if (over) return;
    if (!outcome.ok) {
      problem.value = missed = outcome.problem;
      return;
    }
    if (problem.peek() === missed) problem.value = undefined;
    recordings.value = outcome.value;
  };
  const followed = computed(() => {
    const { a, b } = place.value;
    const known = recordings.value;
    if (known === undefined) return []; // a live device is not asked for as a recording before it is known
    const recorded = (source: string): boolean => known.some(({ id }) => id === source);
    if (b !== undefined) return [a.source, b.source].filter(recorded);
    const other = likelyOther(a, productOf(app, details.value, a), app.store.devices.value, known);
    return [a.source, other.source].filter(recorded);
  });
  const stops = [
    followed.subscribe((sources) => sources.forEach(want)),
    app.store.connection.subscribe(() => {
      // what failed while the server was away is asked for again
      if (recordings.peek() === undefined) void list();
      else followed.peek().forEach(want);
    }),
  ];
  return () => {
    over = true;
    stops.forEach((stop) => stop());
  };
}

/** The request of a place; without an offset by the clock, or from the starts if the clocks do not overlap. */
export function requestOf(model: CompareModel, { a, b, signal: name, signalB, offset }: Ready): ComparisonRequest {
  const { store } = model.app;
  const asked = (side: SideChoice): ComparedSide => requestedSide(side, store.edgeOf(side.source));
  const [first, second] = [asked(a), asked(b)];
  const [own, other] = [boundsOf(model, a), boundsOf(model, b)];
  const ends = [
    [first.t0 ?? own[0], first.t1 ?? own[1]],
    [second.t0 ?? other[0], second.t1 ?? other[1]],
  ] as const;
  const overlaps = Math.min(ends[0][1], ends[1][1]) > Math.max(ends[0][0], ends[1][0]);
  return {
    a: first,
    b: second,
    signals: [name],
    signals_b: signalB ? [signalB] : [],
    ...(offset === undefined ? { align: overlaps ? "offset" : "start", offset: 0 } : { align: "offset", offset }),
    // what stands still can be zoomed into
    columns: a.last === undefined && b.last === undefined ? 4000 : 800,
  };
}

/** Asks for the comparison. */
export async function compareNow(model: CompareModel, over: AbortSignal): Promise<void> {
  const wanted = model.ready.peek();
  if (!wanted?.signal) return;
  const outcome = await request("POST /api/comparison", { body: requestOf(model, wanted), signal: over });
  if (!over.aborted) model.latest.take(JSON.stringify(wanted), outcome);
}

/** Moves B to the offset that correlates best, unless the user chooses others meanwhile. */
export async function correlate(model: CompareModel): Promise<void> {
  const { ready, latest, problem, correlating, place, aligned } = model;
  const [wanted, before] = [ready.peek(), place.peek()];
  if (!wanted?.signal) return;
  correlating.value = true;
  problem.value = undefined;
  const body = requestOf(model, wanted);
  const outcome = await request("POST /api/comparison", {
    body: { ...body, align: "correlation", offset: 0, search: null },
  });
  correlating.value = false;
  if (place.peek() !== before) return;
  if (!outcome.ok) {
    problem.value = outcome.problem;
    return;
  }
  aligned.value = outcome.value;
  const isOneLive = (wanted.a.last === undefined) !== (wanted.b.last === undefined);
  // beside a recording the aligned range of a live device stays in sight; two live devices go on together
  const hold = (side: SideChoice, { t0, t1 }: ComparedSide): SideChoice =>
    isOneLive && side.last !== undefined && t0 !== null && t1 !== null
      ? { source: side.source, device: side.device, begin: t0, end: t1 }
      : side;
  place.value = {
    ...wanted,
    a: hold(wanted.a, body.a),
    b: hold(wanted.b, body.b),
    offset: outcome.value.offset,
  };
  latest.take(JSON.stringify(ready.peek()), outcome);
}
