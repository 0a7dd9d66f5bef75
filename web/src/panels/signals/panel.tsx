/**
 * The tree of all signals, beside the plots: from here a signal goes onto any plot, by dragging it there, by a button, or by keys.
 *
 *     ↑ ↓ Home End   move      → ←   unfold, fold      Enter   go to the plots for the signal      Esc   close
 *     Space, Ctrl+click   choose several      Shift+↑ ↓, Shift+click   choose a range      Ctrl+A   choose all
 */
import { type Signal, untracked, useComputed, useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import type { CustomPlot, PlotSpec } from "../../data/view";
import { Slot } from "../../extension/extension";
import { reading } from "../panel-context";
import type { Deps } from "../../page/context";
import { protocolAmong } from "../../wire/capabilities";
import { usualPlots } from "../../signals/plot-selection";
import { Button } from "../../ui/controls/button";
import { IconButton } from "../../ui/controls/icon-button";
import { SearchField } from "../../ui/controls/search-field";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/signals";
import {
  added,
  heldOf,
  misfit,
  signalRef,
  removed,
  type Target,
  targetOf,
  unitOf,
  withCustomPlots,
} from "../../signals/custom-plots";
import { listenForDrops } from "../../signals/drag";
import { type Choosing, SignalRow } from "./row";
import { parentOf, type TreeRow, treeRows } from "../../signals/tree-rows";
import "./signals.css";

interface SignalsProps {
  readonly deps: Deps;
  readonly isLive: boolean;
  /** Takes the last action, in words. */
  readonly onSaid: (words: string) => void;
}

declare module "../../extension/extension" {
  interface Slots {
    /** Actions of the row that is chosen. */
    readonly signalActions: SignalsProps & { readonly row: TreeRow };
    /** Actions over the tree of signals. */
    readonly signalsHead: SignalsProps;
  }
}

/** Signals that a search may put on a plot together. */
const MAX_TOGETHER = 12;

interface Props {
  readonly deps: Deps;
  /** Counts half seconds: values follow it. */
  readonly tick: Signal<number>;
  /** Whether signals can be computed from others. */
  readonly isLive: boolean;
  readonly onClose: () => void;
}

export function SignalsPanel({ deps, tick, isLive, onClose }: Props) {
  const { store, viewState } = deps;
  const { view, extraPlots, customPlots } = viewState;
  const root = useRef<HTMLElement>(null);
  const search = useSignal("");
  const open = useSignal<ReadonlySet<string>>(new Set([view.peek().device ?? ""]));
  const current = useSignal("");
  const several = useSignal<ReadonlySet<string>>(new Set());
  const said = useSignal("");
  const onSaid = (text: string): void => void (said.value = text);
  const rows = useComputed(() => treeRows(store.devices.value, store.channels.value, open.value, search.value));
  const plots = useComputed(() => {
    const device = viewState.device.value;
    const own = store.channels.value.filter(({ info }) => info.device === device);
    const all = usualPlots(own, protocolAmong(store.devices.value, device)?.plots);
    const shown = all.filter(({ primary, key }) => primary !== extraPlots.value.has(key));
    return withCustomPlots(shown, customPlots.value, store.channels.value, device);
  });
  const chosen = useComputed(() => {
    const all = rows.value.filter(({ key, columns }) => several.value.has(key) && columns.length > 0);
    return all.length > 0 ? all : rows.value.filter(({ key }) => key === current.value);
  });
  /** What a search has found, if it fits a plot. */
  const found = useComputed(() => {
    const all = search.value.trim() === "" ? [] : finest(rows.value);
    return all.length <= MAX_TOGETHER ? all : [];
  });
  const choose = (key: string, how: Choosing): void => {
    if (how === "range") {
      const keys = rows.peek().map((row) => row.key);
      const ends = [keys.indexOf(current.peek()), keys.indexOf(key)].sort((a, b) => a - b);
      several.value = new Set([...several.peek(), ...keys.slice(ends[0], (ends[1] ?? 0) + 1)]);
    } else if (how === "one") several.value = new Set();
    else {
      const others = several.peek().size > 0 || current.peek() === key ? several.peek() : new Set([current.peek()]);
      several.value = toggled(others, key);
    }
    current.value = key;
  };

  const put = (put: readonly TreeRow[], plot: PlotSpec | undefined): void => {
    const outcome = putOn(customPlots.peek(), put, plot, view.peek().device ?? "");
    said.value = outcome.said;
    if (outcome.plots) customPlots.value = outcome.plots;
    if (plot === undefined && outcome.plots) showLast(root.current);
  };
  const takeOff = (taken: readonly TreeRow[], plot: PlotSpec): void => {
    const target = targetOf(plot, view.peek().device ?? "");
    customPlots.value = removed(customPlots.peek(), target, refsOf(taken));
    said.value = TEXT.removedFrom(nameOf(taken), plot.title);
  };

  const drop = useRef<(key: string, plot: string | undefined) => void>(() => undefined);
  drop.current = (key, plotKey) => {
    const dropped = several.peek().has(key) ? chosen.peek() : rows.peek().filter((one) => one.key === key);
    if (dropped.length > 0)
      put(
        dropped,
        plots.peek().find((one) => one.key === plotKey),
      );
  };
  useEffect(() => {
    const before = document.activeElement;
    root.current?.querySelector<HTMLInputElement>("input[type=search]")?.focus();
    const page = root.current?.closest<HTMLElement>(".app");
    const stop = page && listenForDrops(page, (key, plot) => drop.current(key, plot));
    return () => {
      stop?.();
      if (before instanceof HTMLElement && before.isConnected) before.focus();
    };
  }, []);

  const onKey = (event: KeyboardEvent): void => {
    if (event.key !== "Escape" || (event.target as Element).closest("dialog")) return;
    event.preventDefault();
    event.stopPropagation();
    const tree = root.current?.querySelector<HTMLElement>('[role="treeitem"][tabindex="0"]');
    if ((event.target as Element).closest(".signal-targets") && tree) tree.focus();
    else onClose();
  };
  void tick.value;
  const at = untracked(() => reading(deps)); // at the pace of the clock, not of a drag
  return (
    <section ref={root} class="signals-panel flex-column" aria-label={TEXT.signals} onKeyDown={onKey}>
      <div class="head">
        <h2>{TEXT.signals}</h2>
        <span class="grow" />
        <Slot name="signalsHead" with={{ deps, isLive, onSaid }} />
        <IconButton icon="close" label={COMMON.close} title={COMMON.closeEsc} onClick={onClose} />
      </div>
      <SearchField
        class="signal-search"
        label={TEXT.search}
        placeholder={TEXT.searchHint}
        value={search.value}
        onText={(text) => (search.value = text)}
        onKeyDown={(event) => {
          if (event.key === "ArrowDown") focusRow(root.current, 0);
          else if (event.key === "Enter" && found.value.length > 0) put(found.value, undefined);
          else return;
          event.preventDefault();
        }}
      />
      <Tree
        rows={rows.value}
        current={current}
        open={open}
        onChoose={choose}
        onAll={() => (several.value = new Set(finest(rows.peek()).map(({ key }) => key)))}
        onEnter={() => root.current?.querySelector<HTMLElement>(".signal-targets button")?.focus()}
        row={(row, isTabStop, onKey) => (
          <SignalRow
            key={row.key}
            row={row}
            at={at}
            isCurrent={several.value.size > 0 ? several.value.has(row.key) : row.key === current.value}
            isTabStop={isTabStop}
            onFold={() => (open.value = toggled(open.peek(), row.key))}
            onChoose={(how) => (how ? choose(row.key, how) : (current.value = row.key))}
            onPlot={() => put([row], undefined)}
            onKey={onKey}
          />
        )}
      />
      {found.value.length > 0 && (
        <p class="signal-targets flex-row mid text-sm">
          <Button
            look="edge"
            icon="plus"
            words={TEXT.plotFound(nameOf(found.value))}
            title={TEXT.plotFoundHint}
            onClick={() => put(found.value, undefined)}
          />
        </p>
      )}
      {rows.value.length === 0 && (
        <p class="signal-none">{search.value === "" ? TEXT.noSignals : TEXT.nothingFound(search.value)}</p>
      )}
      <Targets
        rows={chosen.value}
        plots={plots.value}
        custom={customPlots.value}
        device={viewState.device.value ?? ""}
        onPut={put}
        onTakeOff={takeOff}
      >
        {chosen.value.length === 1 && chosen.value[0] && (
          <Slot name="signalActions" with={{ deps, row: chosen.value[0], isLive, onSaid }} />
        )}
      </Targets>
      <p class="signal-said" role="status">
        {said.value}
      </p>
    </section>
  );
}

interface TreeProps {
  readonly rows: readonly TreeRow[];
  readonly current: Signal<string>;
  readonly open: Signal<ReadonlySet<string>>;
  readonly onEnter: () => void;
  readonly onChoose: (key: string, how: Choosing) => void;
  readonly onAll: () => void;
  readonly row: (row: TreeRow, isTabStop: boolean, onKey: (event: KeyboardEvent) => void) => preact.ComponentChildren;
}

function Tree({ rows, current, open, onEnter, onChoose, onAll, row }: TreeProps) {
  const ref = useRef<HTMLDivElement>(null);
  const tabStop = Math.max(
    0,
    rows.findIndex(({ key }) => key === current.value),
  );
  const go = (to: number): void => {
    const next = rows[Math.min(rows.length - 1, Math.max(0, to))];
    if (!next) return;
    current.value = next.key;
    focusRow(ref.current, rows.indexOf(next));
  };
  const onKey = (event: KeyboardEvent): void => {
    if (event.altKey) return;
    if (event.ctrlKey || event.metaKey) {
      if (event.key.toLowerCase() !== "a") return;
      event.preventDefault();
      return onAll();
    }
    const key = (event.currentTarget as Element).getAttribute("data-row");
    const at = rows.findIndex((row) => row.key === key);
    const here = rows[at];
    if (!here) return;
    const extend = (to: number): void => {
      const next = rows[Math.min(rows.length - 1, Math.max(0, to))];
      if (next) onChoose(next.key, "range");
      go(to);
    };
    const moves: Readonly<Record<string, () => void>> = {
      " ": () => onChoose(here.key, "another"),
      ArrowDown: () => go(at + 1),
      ArrowUp: () => go(at - 1),
      Home: () => go(0),
      End: () => go(rows.length - 1),
      ArrowRight: () => (here.open === false ? (open.value = toggled(open.peek(), here.key)) : go(at + 1)),
      ArrowLeft: () =>
        here.open === true && open.peek().has(here.key)
          ? (open.value = toggled(open.peek(), here.key))
          : go(parentOf(rows, at)),
      Enter: () => (here.columns.length > 0 ? onEnter() : (open.value = toggled(open.peek(), here.key))),
      ...(event.shiftKey ? { ArrowDown: () => extend(at + 1), ArrowUp: () => extend(at - 1) } : {}),
    };
    const move = moves[event.key];
    if (!move || ("Enter ".includes(event.key) && event.target instanceof HTMLButtonElement)) return;
    event.preventDefault();
    event.stopPropagation();
    move();
  };
  return (
    <div class="signal-tree" ref={ref} role="tree" aria-multiselectable aria-label={TEXT.treeLabel}>
      {rows.map((one, k) => row(one, k === tabStop, onKey))}
    </div>
  );
}

interface TargetsProps {
  readonly rows: readonly TreeRow[];
  readonly plots: readonly PlotSpec[];
  readonly custom: readonly CustomPlot[];
  readonly device: string;
  readonly onPut: (rows: readonly TreeRow[], plot: PlotSpec | undefined) => void;
  readonly onTakeOff: (rows: readonly TreeRow[], plot: PlotSpec) => void;
  /** Further actions. */
  readonly children: preact.ComponentChildren;
}

/** The plots for the chosen signals: a pressed one has them. */
function Targets({ rows, plots, custom, device, onPut, onTakeOff, children }: TargetsProps) {
  if (!rows.some(({ columns }) => columns.length > 0))
    return <p class="signal-targets flex-row mid text-sm">{TEXT.nothingChosen}</p>;
  const refs = refsOf(rows);
  return (
    <div class="signal-targets flex-row mid text-sm" role="group" aria-label={TEXT.choose(nameOf(rows))}>
      <span>{TEXT.choose(nameOf(rows))}</span>
      <Button look="edge" icon="plus" words={TEXT.newPlot} onClick={() => onPut(rows, undefined)} />
      {plots.map((plot) => {
        const held = heldOf(custom, targetOf(plot, device), refs).length === refs.length;
        const fits = misfit(unitsOf(rows), plot) === undefined;
        return (
          <Button
            key={plot.key}
            look="edge"
            aria-pressed={held}
            aria-disabled={!fits}
            onClick={() => (held ? onTakeOff(rows, plot) : onPut(rows, plot))}
          >
            <span class="ellipsis">{plot.title}</span>
          </Button>
        );
      })}
      {children}
    </div>
  );
}

const toggled = (open: ReadonlySet<string>, key: string): ReadonlySet<string> => {
  const next = new Set(open);
  if (!next.delete(key)) next.add(key);
  return next;
};

/** A whole channel is plotted without its norm, which would squeeze the axes. */
function refsOf(rows: readonly TreeRow[]) {
  return rows.flatMap(({ channel, columns }) => {
    if (!channel) return [];
    const plain = columns.filter((c) => columns.length === 1 || channel.info.columns[c]?.name !== "norm");
    return plain.map((c) => signalRef(channel, c));
  });
}

function unitsOf(rows: readonly TreeRow[]): readonly string[] {
  const all = rows.flatMap(({ channel, columns }) =>
    channel ? columns.map((column) => unitOf({ channel, column })) : [],
  );
  return [...new Set(all)];
}

function nameOf(rows: readonly TreeRow[]): string {
  const [first] = rows;
  if (!first || rows.length > 1) return TEXT.severalSignals(rows.length);
  const { level, name, channel } = first;
  return level === 3 && channel ? `${channel.info.title || channel.info.name} ${name}` : name;
}

/** The signals that have nothing under them on screen. */
const finest = (rows: readonly TreeRow[]): readonly TreeRow[] =>
  rows.filter(({ level, columns }, k) => columns.length > 0 && (rows[k + 1]?.level ?? 0) <= level);

/** What becomes of the plots, and a sentence about it. */
export function putOn(
  custom: readonly CustomPlot[],
  rows: readonly TreeRow[],
  plot: PlotSpec | undefined,
  device: string,
): { readonly plots: readonly CustomPlot[] | undefined; readonly said: string } {
  const [units, name] = [unitsOf(rows), nameOf(rows)];
  if (units.length > 2) return { plots: undefined, said: TEXT.differentUnits };
  const problem = plot && misfit(units, plot);
  if (problem !== undefined) return { plots: undefined, said: problem };
  const target: Target = plot === undefined ? { kind: "new" } : targetOf(plot, device);
  const said = plot === undefined ? TEXT.addedNew(name) : TEXT.addedTo(name, plot.title);
  return { plots: added(custom, target, refsOf(rows)), said };
}

function focusRow(root: HTMLElement | null, at: number): void {
  // the row gets its tab stop with the next rendering
  const row = root?.querySelectorAll<HTMLElement>("[data-row]")[at];
  row?.focus();
  row?.scrollIntoView({ block: "nearest" });
}

/** Bring the new plot, the last one, into view. */
function showLast(root: HTMLElement | null): void {
  const plots = root?.closest(".app")?.querySelectorAll(".stack > .plot") ?? [];
  plots[plots.length - 1]?.scrollIntoView({ block: "nearest" });
}
