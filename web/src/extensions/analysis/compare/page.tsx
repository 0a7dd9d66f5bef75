/** The page that compares two recordings, devices or ranges on one axis of time. Loaded on first use. */
import { useComputed, useSignal, useSignalEffect } from "@preact/signals";
import { useEffect, useMemo } from "preact/hooks";
import { figure } from "../../../charts/axes";
import { TopBar } from "../../../pages/top-bar";
import type { App } from "../../../page/context";
import { OfflineBand, ProblemBand } from "../../../pages/empty-states";
import { PageOverlays } from "../../../pages/overlays";
import { route } from "../../../page/route";
import { Button } from "../../../ui/controls/button";
import { copyText } from "../../../ui/dom/copy";
import { Message } from "../../../ui/controls/message";
import { ProblemNote } from "../../../requests/problem-note";
import { Answered } from "../../../requests/use-answer";
import { Proposals } from "../proposals";
import type { ComparedSignal, ComparisonAnswer } from "../../../wire/routes";
import { Controls } from "./controls";
import {
  compareModel,
  type CompareModel,
  compareNow,
  correlate,
  loadSources,
  missingSide,
  type Ready,
  unknownSources,
} from "./model";
import { OverlayChart, type Trace } from "./overlay-chart";
import { Settings, Spectra, Statistics } from "./results";
import { comparisonHref, readComparison } from "./sides";
import { TEXT } from "./texts";
import "../analysis.css";
import type { Ends } from "./zoom";
import "./compare.css";

/** Pause after a change of the offset, ms. */
const CHANGED_MS = 120;
/** A live side is compared again this often, ms, as far as the server keeps up. */
const LIVE_MS = 1500;
const OVERLAY_PX = 190;
const DIFFERENCE_PX = 150;

export function ComparePage({ app }: { readonly app: App }) {
  const offline = app.store.connection.value === "closed" || app.store.silentSince.value !== undefined;
  return (
    <div class={`app comparing ${offline ? "offline" : ""}`}>
      <TopBar app={app} />
      {offline && <OfflineBand app={app} />}
      <CompareMain app={app} />
      <PageOverlays app={app} />
    </div>
  );
}

/** All but the bar and what lies over the page. */
export function CompareMain({ app }: { readonly app: App }) {
  const model = useMemo(() => compareModel(app, route.peek().query ?? ""), [app]);
  useEffect(() => {
    document.title = TEXT.title;
    const stops = [loadSources(model), followAddress(model)];
    return () => stops.forEach((stop) => stop());
  }, [model]);
  return (
    <main class="compare-page" id="list" tabIndex={-1}>
      <h1 class="visually-hidden">{TEXT.heading}</h1>
      <ProblemBand app={app} />
      <Comparison model={model} />
    </main>
  );
}

function Comparison({ model }: { readonly model: CompareModel }) {
  const { ready, shown, latest, problem, correlating, place, dragged } = model;
  useSignalEffect(() => {
    const wanted = ready.value;
    if (!wanted) return undefined;
    const cancel = new AbortController();
    let timer: ReturnType<typeof setTimeout> | undefined;
    const isMoving = [wanted.a, wanted.b].some(({ last }) => last !== undefined);
    const ask = async (): Promise<void> => {
      if (dragged.peek() === 0 && !correlating.peek()) await compareNow(model, cancel.signal);
      if (isMoving && !cancel.signal.aborted) timer = setTimeout(() => void ask(), LIVE_MS);
    };
    timer = setTimeout(() => void ask(), latest.isEmpty ? 0 : CHANGED_MS);
    return () => {
      clearTimeout(timer);
      cancel.abort();
    };
  });
  const wanted = ready.value;
  if (!wanted) {
    const [unknown] = unknownSources(model);
    if (problem.value) return <ProblemNote problem={problem.value} />;
    if (unknown !== undefined) return <p role="status">{TEXT.unknown(unknown)}</p>;
    return <p aria-busy="true">{TEXT.opening}</p>;
  }
  const offset = wanted.offset ?? shown.value.answer?.offset ?? 0;
  const move = (seconds: number, isDone: boolean): void => {
    dragged.value = isDone ? 0 : seconds;
    if (!isDone || seconds === 0) return;
    model.aligned.value = undefined;
    place.value = { ...wanted, offset: Number((offset + seconds).toFixed(6)) };
  };
  return (
    <>
      <Controls model={model} wanted={wanted} correlate={() => void correlate(model)} />
      <Status model={model} />
      {problem.value && <ProblemNote problem={problem.value} />}
      <Answered
        of={shown.value}
        waiting={<p aria-busy="true">{TEXT.computing}</p>}
        instead={({ kind }) => kind === "not-found" && <Instead model={model} wanted={wanted} />}
      >
        {(answer) => (
          <>
            <Charts answer={{ ...answer, offset }} move={move} dragged={dragged.value} />
            <Notes answer={answer} />
            <Statistics signals={answer.signals} />
            <Spectra model={model} wanted={wanted} />
            <Settings wanted={wanted} />
          </>
        )}
      </Answered>
    </>
  );
}

/** Signals of the side that has not what is compared. */
function Instead({ model, wanted }: { readonly model: CompareModel; readonly wanted: Ready }) {
  const lacks = missingSide(model, wanted);
  const choose = (name: string): void => {
    model.place.value = { ...wanted, ...(lacks.side === "a" ? { signal: name } : { signalB: name }) };
  };
  return <Proposals names={lacks.names} choose={choose} />;
}

/** The uncertainty of the offset, and the link. */
function Status({ model: { aligned, place, ready } }: { readonly model: CompareModel }) {
  const said = useSignal("");
  const found = aligned.value;
  const copy = async (): Promise<void> => {
    const wanted = ready.peek() ?? place.peek();
    const isDone = await copyText(new URL(comparisonHref(wanted), location.href).href);
    said.value = isDone ? TEXT.linkCopied : TEXT.linkNotCopied;
  };
  return (
    <div class="compare-sides compare-words text-sm">
      <span role="status">
        {found && found.uncertainty !== null && (
          <>
            <b>
              {figure(found.offset, 7)} s {TEXT.uncertainty(`${figure(found.uncertainty, 2)} s`)}
            </b>{" "}
            <span class="dim">{TEXT.aligned(figure(found.correlation, 3), `${figure(found.overlap, 3)} s`)}</span>
          </>
        )}
      </span>
      <span class="grow" />
      <span role="status">{said.value}</span>
      <Button look="edge" icon="share" words={TEXT.copyLink} onClick={() => void copy()} />
    </div>
  );
}

interface ChartsProps {
  readonly answer: ComparisonAnswer;
  readonly move: (seconds: number, isDone: boolean) => void;
  readonly dragged: number;
}

/** For each signal A and B, and their difference below. */
function Charts({ answer: { signals, offset }, move, dragged }: ChartsProps) {
  const axis = useComputed(() => axisOf(signals, offset));
  const { origin, ends } = axis.value.of === signals ? axis.value : axisOf(signals, offset);
  const part = useSignal<Ends | undefined>(undefined);
  // another range of A shows everything of it
  const shown = part.value && part.value[0] >= ends[0] && part.value[1] <= ends[1] ? part.value : ends;
  const show = (next: Ends): void => {
    part.value = next[1] - next[0] >= ends[1] - ends[0] ? undefined : next;
  };
  const common = { origin, ends: shown, all: ends, show };
  return (
    <>
      {signals.map(({ signal, unit, a, b, difference }) => {
        const sides: Trace[] = [
          ...(a ? [{ side: "side-a" as const, name: "A", outline: a, offset: 0 }] : []),
          ...(b ? [{ side: "side-b" as const, name: "B", outline: b, offset }] : []),
        ];
        const isAngle = a === null;
        return (
          <div key={signal} data-signal={signal}>
            {sides.length > 0 && (
              <OverlayChart
                label={TEXT.overlay(signal)}
                title={signal}
                unit={unit}
                traces={sides}
                height={OVERLAY_PX}
                move={{ offset: offset + dragged, by: move }}
                dragged={dragged}
                {...common}
              />
            )}
            {difference && (
              <OverlayChart
                label={isAngle ? TEXT.attitude : TEXT.difference(signal)}
                title={isAngle ? TEXT.attitude : TEXT.difference(signal)}
                unit={unit}
                traces={[{ side: "difference", name: "Δ", outline: difference, offset: 0 }]}
                height={DIFFERENCE_PX}
                {...common}
              />
            )}
          </div>
        );
      })}
      <p class="dim compare-words text-sm">
        {TEXT.time}, s. {TEXT.offsetHint}
      </p>
    </>
  );
}

/** The axis of time: from the beginning of A, over both, as far as A is not too small to be seen on it. */
function axisOf(signals: readonly ComparedSignal[], offset: number) {
  const range = (side: "a" | "b", shift: number): readonly [number, number] => {
    const times = signals.flatMap((one) => one[side]?.time ?? []).filter((time) => time !== null);
    return [
      times.reduce((x, y) => Math.min(x, y), Infinity) + shift,
      times.reduce((x, y) => Math.max(x, y), -Infinity) + shift,
    ];
  };
  const [a, b] = [range("a", 0), range("b", offset)];
  const length = Math.max(a[1] - a[0], 1e-3);
  const both = [Math.min(a[0], b[0]), Math.max(a[1], b[1])] as const;
  const [begin, end] = both[1] - both[0] <= 4 * length ? both : [a[0] - length / 2, a[1] + length / 2];
  return { of: signals, origin: a[0], ends: [begin - a[0], end - a[0]] as const };
}

function Notes({ answer: { notes, signals } }: { readonly answer: ComparisonAnswer }) {
  const all = [...new Set([...notes, ...signals.flatMap((one) => one.notes)])];
  if (all.length === 0) return null;
  return (
    <ul class="bullets">
      {all.map((note) => (
        <li key={note}>
          <Message text={note} />
        </li>
      ))}
    </ul>
  );
}

/** Keeps the address up to date, and follows a link that is opened over it. */
function followAddress({ place, ready }: CompareModel): () => void {
  let ours = location.hash;
  const stops = [
    ready.subscribe((wanted) => {
      if (!wanted) return;
      ours = comparisonHref(wanted);
      if (location.hash !== ours) history.replaceState(null, "", ours);
    }),
    route.subscribe(({ query }) => {
      if (location.hash === ours || !/(^|&)a=/.test(query ?? "")) return;
      place.value = readComparison(query ?? "");
    }),
  ];
  return () => stops.forEach((stop) => stop());
}
