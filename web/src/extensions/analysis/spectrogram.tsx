/** A picture of a density over time and frequency. Where there is no segment, as in a gap, there is no colour. */
import { type ReadonlySignal, useSignal } from "@preact/signals";
import type { RefObject } from "preact";
import { useLayoutEffect, useMemo, useRef } from "preact/hooks";
import type { View } from "../../data/view";
import { tickLabel, timeGrid, timeStep } from "../../plots/axis";
import { palette } from "../../plots/canvas-style";
import { timeWindow, type TimeWindow } from "../../plots/time-window";
import { clock } from "../../ui/format/format";
import type { SignalFigures } from "../../wire/routes";
import { type Axis, axisOf, figure, nearest, share, axisTicks, valueAtShare } from "../../charts/axes";
import { colourAt, type ColourScale, scaleOf, shareOf } from "../../charts/colours";
import { chartClass } from "../../charts/chart";
import { useWidth } from "../../charts/use-size";
import { TEXT } from "./texts";

const LEFT = 64;
const RIGHT = 12;
const TOP = 22;
const BOTTOM = 40;
const HEIGHT = 250;
/** Wider images are more than a canvas may be. */
const MAX_IMAGE_PX = 4096;
const BAR = { width: 96, height: 8, steps: 32 };
/** Width of a label of the time axis, px. */
const LABEL_PX = 90;

interface Picture {
  readonly time: readonly number[];
  readonly frequency: readonly number[];
  readonly rows: readonly (readonly (number | null)[])[];
  /** Duration that a column stands for, s. */
  readonly step: number;
  readonly scale: ColourScale;
  readonly x: Axis;
  readonly y: Axis;
}

function pictureOf({ figures, units }: SignalFigures): Picture | undefined {
  const time = (figures["time"] as number[] | undefined) ?? [];
  const frequency = ((figures["frequency"] as number[] | undefined) ?? []).slice(1);
  const rows = ((figures["psd"] as (number | null)[][] | undefined) ?? []).map((row) => row.slice(1)); // without 0 Hz
  const scale = scaleOf(rows.flat(), (units["psd"] ?? "").endsWith("√Hz"));
  const step = Number(figures["step"]) / Number(figures["rate"]);
  const [first, last] = [time[0], time.at(-1)];
  const y = axisOf("linear", frequency);
  if (first === undefined || last === undefined || scale === undefined || !y || !(step > 0)) return undefined;
  return { time, frequency, rows, step, scale, x: { kind: "linear", low: first - step / 2, high: last + step / 2 }, y };
}

/** The columns of a picture beside each other, over all of its times. */
function imageOf({ time, rows, frequency, step, scale, x }: Picture): HTMLCanvasElement | undefined {
  const image = document.createElement("canvas");
  const column = document.createElement("canvas");
  image.width = Math.min(MAX_IMAGE_PX, Math.max(1, 2 * Math.round((x.high - x.low) / step)));
  [image.height, column.width, column.height] = [frequency.length, 1, frequency.length];
  const [context, paint] = [image.getContext("2d"), column.getContext("2d")];
  if (!context || !paint || frequency.length === 0) return undefined;
  const pixels = paint.createImageData(1, frequency.length);
  time.forEach((t, i) => {
    rows[i]?.forEach((value, k) => {
      pixels.data.set([...colourAt(shareOf(scale, value)), 255], (frequency.length - 1 - k) * 4);
    });
    paint.putImageData(pixels, 0, 0);
    const from = Math.floor(share(x, t - step / 2) * image.width);
    const to = Math.ceil(share(x, t + step / 2) * image.width);
    context.drawImage(column, 0, 0, 1, frequency.length, from, 0, Math.max(1, to - from), frequency.length);
  });
  return image;
}

/** Draws the image of a picture where its times are on another axis, over all of a canvas. */
function draw(context: CanvasRenderingContext2D, image: HTMLCanvasElement, own: Axis, shown: Axis): void {
  const { width, height } = context.canvas;
  context.clearRect(0, 0, width, height);
  context.imageSmoothingEnabled = false;
  const [from, to] = [share(shown, own.low) * width, share(shown, own.high) * width];
  context.drawImage(image, from, 0, to - from, height);
}

/** The window of the plots over a picture, for the same times at the same pixels. */
export interface PlotAxis {
  readonly view: ReadonlySignal<View>;
  /** Right edge of a live window, unix s. */
  readonly edge: () => number;
}

interface Frame {
  readonly left: number;
  readonly right: number;
  readonly window: TimeWindow | undefined;
}
const ALONE: Frame = { left: LEFT, right: RIGHT, window: undefined };

/** The room beside a picture; under the plots theirs, with their window, which moves. */
function useFrame(
  host: RefObject<HTMLElement | null>,
  width: ReadonlySignal<number>,
  plots: PlotAxis | undefined,
): Frame {
  const frame = useSignal(ALONE);
  const wide = width.value;
  useLayoutEffect(() => {
    if (!plots || !host.current?.closest(".main-panel")) {
      frame.value = ALONE;
      return undefined;
    }
    const { gutter, tail } = palette(host.current);
    const ratio = globalThis.devicePixelRatio || 1;
    let next = 0;
    const follow = (): void => {
      const { window: was } = frame.peek();
      const window = timeWindow(plots.view.peek(), plots.edge(), gutter, wide - gutter - tail, ratio);
      if (was?.g1 !== window.g1 || was.dt !== window.dt || was.width !== window.width)
        frame.value = { left: gutter, right: tail, window };
      next = requestAnimationFrame(follow);
    };
    follow();
    return () => cancelAnimationFrame(next);
  }, [host, frame, wide, plots]);
  return frame.value;
}

interface SpectrogramProps {
  readonly figures: SignalFigures;
  /** Its time axis is that of the plots. */
  readonly plots?: PlotAxis | undefined;
}

export function Spectrogram({ figures, plots }: SpectrogramProps) {
  const host = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const width = useWidth(host);
  const pointer = useSignal<{ readonly t: number; readonly f: number } | undefined>(undefined);
  const picture = useMemo(() => pictureOf(figures), [figures]);
  const image = useMemo(() => picture && imageOf(picture), [picture]);
  const { left, right, window } = useFrame(host, width, plots);
  const inner = { width: Math.max(1, width.value - left - right), height: HEIGHT - TOP - BOTTOM };
  const x: Axis | undefined = window ? { kind: "linear", low: window.t0, high: window.t1 } : picture?.x;
  useLayoutEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!canvas.current || !context || !picture || !image || !x) return;
    const ratio = globalThis.devicePixelRatio || 1;
    const size = [Math.round(inner.width * ratio), Math.round(inner.height * ratio)] as const;
    if (canvas.current.width !== size[0]) canvas.current.width = size[0];
    if (canvas.current.height !== size[1]) canvas.current.height = size[1];
    draw(context, image, picture.x, x);
  });
  if (!picture || !x) return <div class={chartClass("analysis-chart")} ref={host} />;
  const { y, scale } = picture;
  const unit = figures.units["psd"] ?? "";
  const move = (event: PointerEvent): void => {
    const box = canvas.current?.getBoundingClientRect();
    if (!box) return;
    const [across, down] = [(event.clientX - box.left) / box.width, (event.clientY - box.top) / box.height];
    const isInside = across >= 0 && across <= 1 && down >= 0 && down <= 1;
    pointer.value = isInside ? { t: valueAtShare(x, across), f: valueAtShare(y, 1 - down) } : undefined;
  };
  const at = pointer.value;
  return (
    <div
      class={chartClass(`analysis-chart spectrogram ${plots ? "under-plots" : ""}`)}
      ref={host}
      onPointerMove={move}
      onPointerLeave={() => (pointer.value = undefined)}
    >
      <canvas
        ref={canvas}
        role="img"
        aria-label={TEXT.chart(TEXT.spectrogram, figures.signal)}
        style={{ left: `${left}px`, top: `${TOP}px`, width: `${inner.width}px`, height: `${inner.height}px` }}
      />
      <svg width={width.value} height={HEIGHT} aria-hidden="true">
        <text class="chart-title" x={left} y={14}>
          {figures.signal} · {TEXT.overTime}
        </text>
        <g transform={`translate(${left} ${TOP})`}>
          {axisTicks(y, Math.max(2, Math.floor(inner.height / 34))).map((tick) => (
            <text key={tick.text} x={-8} y={(1 - tick.at) * inner.height} dy="0.32em" text-anchor="end">
              {tick.text}
            </text>
          ))}
          {(window ? plotTicks(window) : timeTicks(x, inner.width)).map(({ t, text }) => (
            <text
              key={t}
              x={labelAt(share(x, t) * inner.width, width.value - left)}
              y={inner.height + 16}
              text-anchor="middle"
            >
              {text}
            </text>
          ))}
        </g>
        <ColourBar scale={scale} unit={unit} right={width.value - right} />
      </svg>
      <Reading picture={picture} unit={unit} at={at} />
    </div>
  );
}

/** Centre of a label, px: over its moment, but wholly on the page. */
const labelAt = (x: number, end: number): number => Math.min(x, end - LABEL_PX / 3);

/** The labels of the plots' axis. */
function plotTicks(window: TimeWindow): readonly { readonly t: number; readonly text: string }[] {
  const step = timeStep(window.span, window.width);
  return timeGrid(window).map((t) => ({ t, text: tickLabel(t, step) }));
}

/** Labels of a time axis, at round seconds or their parts. */
function timeTicks(x: Axis, width: number): readonly { readonly t: number; readonly text: string }[] {
  const base = Math.floor(x.low);
  const relative = { kind: "linear", low: x.low - base, high: x.high - base } as const;
  const most = Math.max(2, Math.floor(width / LABEL_PX));
  const span = x.high - x.low;
  const decimals = span / most < 0.2 ? 2 : span / most < 1 ? 1 : 0;
  return axisTicks(relative, most).map(({ at }) => {
    const t = valueAtShare(x, at);
    return { t, text: clock(t + 1e-6, decimals) };
  });
}

function ColourBar({
  scale,
  unit,
  right,
}: {
  readonly scale: ColourScale;
  readonly unit: string;
  readonly right: number;
}) {
  const left = right - BAR.width;
  const part = BAR.width / BAR.steps;
  return (
    <g class="colour-bar">
      {Array.from({ length: BAR.steps }, (_, i) => (
        <rect
          key={i}
          x={left + i * part}
          y={HEIGHT - 9}
          width={part + 0.5}
          height={BAR.height}
          fill={`rgb(${colourAt((i + 0.5) / BAR.steps).join(" ")})`}
        />
      ))}
      <text x={left - 6} y={HEIGHT - 2} text-anchor="end">
        {figure(scale.low, 2)} … {figure(scale.high, 2)} {unit}
      </text>
    </g>
  );
}

interface ReadingProps {
  readonly picture: Picture;
  readonly unit: string;
  readonly at: { readonly t: number; readonly f: number } | undefined;
}

/** The figure under the pointer. */
function Reading({ picture: { time, frequency, rows, step }, unit, at }: ReadingProps) {
  const i = at === undefined ? -1 : nearest(time, at.t);
  const k = at === undefined ? -1 : nearest(frequency, at.f);
  const isThere = at !== undefined && Math.abs((time[i] ?? NaN) - at.t) <= step;
  return (
    <p class="chart-reading analysis-reading">
      {isThere && (
        <>
          <b>
            {figure(frequency[k])} Hz {TEXT.at} {clock(time[i] ?? NaN, 2)}
          </b>
          <span>
            {figure(rows[i]?.[k])} {unit}
          </span>
        </>
      )}
    </p>
  );
}
