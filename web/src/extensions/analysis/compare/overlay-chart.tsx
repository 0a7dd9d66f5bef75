/** A chart of outlines over time: A and B on one axis, of which B can be dragged; or their difference. */
import { useSignal } from "@preact/signals";
import { useEffect, useRef } from "preact/hooks";
import { type Axis, axisOf, figure, nearest, share } from "../../../charts/axes";
import { Chart, chartClass, pointIn, useChart, valueUnder } from "../../../charts/chart";
import { type ChartArea, Crosshair } from "../../../charts/grid";
import type { Outline } from "../../../wire/routes";
import { TEXT } from "./texts";
import { type Ends, keyed, panned, wheeled, zoomedRange } from "./zoom";

export interface Trace {
  /** Class of its colour. */
  readonly side: "side-a" | "side-b" | "difference";
  readonly name: string;
  readonly outline: Outline;
  /** s to add to its times. */
  readonly offset: number;
}

interface Props {
  readonly label: string;
  readonly title: string;
  readonly unit: string;
  readonly traces: readonly Trace[];
  /** What stands at 0 of the axis, unix s, and the ends of the axis, s after it. */
  readonly origin: number;
  readonly ends: readonly [number, number];
  readonly height: number;
  /** Present offset, and what changes it; a chart without them cannot be dragged. */
  readonly move?: { readonly offset: number; readonly by: (seconds: number, isDone: boolean) => void };
  readonly dragged?: number;
  /** Everything there is along the axis, and what shows another part of it. */
  readonly all: Ends;
  readonly show: (ends: Ends) => void;
}

const MARGINS = { left: 64, right: 12, top: 18, bottom: 20 };
/** Least room of a figure along each axis, px. */
const ROOM = [90, 24] as const;
/** Share of the axis that an arrow key moves B by. */
const NUDGE = 1 / 2000;

export function OverlayChart({
  label,
  title,
  unit,
  traces,
  origin,
  ends,
  height,
  move,
  dragged = 0,
  all,
  show,
}: Props) {
  const size = useChart(MARGINS, height);
  const { host, area: inner } = size;
  const pointer = useSignal<number | undefined>(undefined);
  const grip = useRef<number | undefined>(undefined);
  const x: Axis = { kind: "linear", low: ends[0], high: ends[1] };
  const y = axisOf(
    "linear",
    traces.flatMap(({ outline }) => [...outline.low, ...outline.high]),
  );
  const perPixel = (ends[1] - ends[0]) / inner.width;
  /** Fingers by their ids; a second one zooms, and gives B back. */
  const fingers = useRef(new Map<number, number>());
  const shareAt = (clientX: number): number => pointIn(size, { clientX, clientY: 0 })[0] / inner.width;
  const wheel = useRef<(event: WheelEvent) => void>(() => undefined);
  wheel.current = (event) => {
    event.preventDefault();
    show(wheeled(ends, all, event, Math.min(1, Math.max(0, shareAt(event.clientX)))));
  };
  // biome-ignore lint/correctness/useExhaustiveDependencies: its element stays the same
  useEffect(() => {
    const chart = host.current;
    const onWheel = (event: WheelEvent): void => wheel.current(event);
    chart?.addEventListener("wheel", onWheel, { passive: false });
    return () => chart?.removeEventListener("wheel", onWheel);
  }, []);
  const begin = (event: PointerEvent): void => {
    if (event.button !== 0) return;
    fingers.current.set(event.pointerId, event.clientX);
    if (fingers.current.size === 2) {
      if (grip.current !== undefined) move?.by(0, true);
      grip.current = undefined;
      return;
    }
    grip.current = event.clientX;
    host.current?.setPointerCapture?.(event.pointerId);
  };
  const drag = (event: PointerEvent): void => {
    const before = fingers.current.get(event.pointerId);
    if (before !== undefined) fingers.current.set(event.pointerId, event.clientX);
    const [other] = [...fingers.current].flatMap(([id, at]) => (id === event.pointerId ? [] : [at]));
    if (before !== undefined && other !== undefined) {
      const [was, is] = [Math.abs(before - other), Math.abs(event.clientX - other)];
      if (was > 8 && is > 8) show(zoomedRange(ends, all, was / is, shareAt((event.clientX + other) / 2)));
      return;
    }
    if (grip.current !== undefined && move) return move.by((event.clientX - grip.current) * perPixel, false);
    if (grip.current !== undefined && before !== undefined)
      return show(panned(ends, all, (before - event.clientX) / inner.width));
    pointer.value = valueUnder(size, x, event);
  };
  const end = (event: PointerEvent): void => {
    fingers.current.delete(event.pointerId);
    if (grip.current === undefined) return;
    const seconds = (event.clientX - grip.current) * perPixel;
    grip.current = undefined;
    move?.by(seconds, true);
  };
  const press = (event: KeyboardEvent): void => {
    const isPlain = !event.ctrlKey && !event.metaKey && !event.altKey;
    const next = isPlain ? keyed(ends, all, event.key) : undefined;
    if (next) {
      event.preventDefault();
      event.stopPropagation();
      return show(next);
    }
    const way = event.key === "ArrowLeft" ? -1 : event.key === "ArrowRight" ? 1 : 0;
    if (way === 0 || !isPlain) return;
    event.preventDefault();
    event.stopPropagation();
    if (!move) return show(panned(ends, all, way / 10));
    move.by(way * (ends[1] - ends[0]) * NUDGE * (event.shiftKey ? 10 : 1), true);
  };
  const slides = move
    ? {
        "aria-valuenow": Number(move.offset.toFixed(6)),
        "aria-valuetext": `${figure(move.offset)} s`,
      }
    : {};
  return (
    // biome-ignore lint/a11y/noStaticElementInteractions: it has a role, a slider as long as B can be moved
    // biome-ignore lint/a11y/useAriaPropsSupportedByRole: both roles have a name
    <div
      class={chartClass(`analysis-chart overlay-chart ${move ? "movable" : ""}`)}
      ref={host}
      style={{ minHeight: `${height}px` }}
      onPointerDown={begin}
      onPointerMove={drag}
      onPointerUp={end}
      onPointerCancel={end}
      onPointerLeave={() => (pointer.value = undefined)}
      onKeyDown={press}
      onDblClick={() => show(all)}
      tabIndex={0}
      title={move ? TEXT.zoomAndMove : TEXT.zoomAndPan}
      role={move ? "slider" : "img"}
      aria-label={label}
      {...slides}
    >
      <Chart size={size} x={x} y={y} room={ROOM} yTitle={`${title} ${unit}`} yTitleX={MARGINS.left}>
        <svg {...inner} overflow="hidden">
          {y &&
            traces.map(({ side, outline, offset, name }) => (
              <g
                key={name}
                class={side}
                transform={side === "side-b" ? `translate(${(dragged / perPixel).toFixed(1)} 0)` : ""}
              >
                <path class="trace" d={path(outline, offset - origin, { x, y }, inner)} />
              </g>
            ))}
          {pointer.value !== undefined && <Crosshair x={share(x, pointer.value) * inner.width} {...inner} />}
        </svg>
        <text class="chart-title" x={inner.width} y={12 - MARGINS.top} text-anchor="end">
          {pointer.value !== undefined && reading(traces, pointer.value + origin, unit, pointer.value)}
        </text>
      </Chart>
    </div>
  );
}

/** A line through least and greatest values, broken in gaps. */
export function path(
  { time, low, high }: Outline,
  shift: number,
  axes: { readonly x: Axis; readonly y: Axis },
  { width, height }: ChartArea,
): string {
  const parts: string[] = [];
  let isNew = true;
  time.forEach((at, i) => {
    const [least, most] = [low[i], high[i]];
    if (at === null || least === null || most === null || least === undefined || most === undefined) {
      isNew = true;
      return;
    }
    const px = (share(axes.x, at + shift) * width).toFixed(1);
    const [top, bottom] = [most, least].map((value) => ((1 - share(axes.y, value)) * height).toFixed(1));
    parts.push(`${isNew ? "M" : "L"}${px} ${top}${top === bottom ? "" : `L${px} ${bottom}`}`);
    isNew = false;
  });
  return parts.join("");
}

/** The values of the traces at a time, unix s. */
function reading(traces: readonly Trace[], at: number, unit: string, shown: number): string {
  const values = traces.map(({ name, outline, offset }) => {
    const i = nearest(outline.time, at - offset);
    const [low, high] = [outline.low[i], outline.high[i]];
    const value = low !== null && high !== null && low !== undefined && high !== undefined ? (low + high) / 2 : null;
    return `${name} ${figure(value)} ${unit}`;
  });
  return [`${figure(shown)} s`, ...values].join("   ");
}
