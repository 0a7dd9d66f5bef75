/** A picture of a density over time and frequency. Where there is no segment, as in a gap, there is no colour. */
import { useSignal } from "@preact/signals";
import { useLayoutEffect, useRef } from "preact/hooks";
import { clock } from "../ui/format";
import type { SignalFigures } from "../wire/routes";
import { type Axis, axisOf, figure, nearest, share, ticks, valueAtShare } from "../charts/axes";
import { colourAt, type Scale, scaleOf, shareOf } from "./colours";
import { useWidth } from "../charts/use-size";
import { TEXT } from "../texts/analysis";

const LEFT = 64;
const RIGHT = 12;
const TOP = 22;
const BOTTOM = 40;
const HEIGHT = 250;
const BAR = { width: 96, height: 8, steps: 32 };
/** Width of a label of the time axis, px. */
const LABEL_PX = 90;

interface Picture {
  readonly time: readonly number[];
  readonly frequency: readonly number[];
  readonly rows: readonly (readonly (number | null)[])[];
  /** Duration that a column stands for, s. */
  readonly step: number;
  readonly scale: Scale;
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

/** Draws a picture of `width` × `height` device pixels. */
function draw(context: CanvasRenderingContext2D, picture: Picture, width: number, height: number): void {
  context.clearRect(0, 0, width, height);
  const { time, rows, frequency, step, scale, x } = picture;
  if (frequency.length === 0 || time.length === 0) return;
  const column = context.createImageData(1, frequency.length);
  const buffer = document.createElement("canvas");
  [buffer.width, buffer.height] = [1, frequency.length];
  const paint = buffer.getContext("2d");
  if (!paint) return;
  context.imageSmoothingEnabled = false;
  time.forEach((t, i) => {
    rows[i]?.forEach((value, k) => {
      const at = (frequency.length - 1 - k) * 4;
      column.data.set([...colourAt(shareOf(scale, value)), 255], at);
    });
    paint.putImageData(column, 0, 0);
    const from = Math.floor(share(x, t - step / 2) * width);
    const to = Math.ceil(share(x, t + step / 2) * width);
    context.drawImage(buffer, 0, 0, 1, frequency.length, from, 0, Math.max(1, to - from), height);
  });
}

export function Spectrogram({ figures }: { readonly figures: SignalFigures }) {
  const host = useRef<HTMLDivElement>(null);
  const canvas = useRef<HTMLCanvasElement>(null);
  const width = useWidth(host);
  const pointer = useSignal<{ readonly t: number; readonly f: number } | undefined>(undefined);
  const picture = pictureOf(figures);
  const inner = { width: width.value - LEFT - RIGHT, height: HEIGHT - TOP - BOTTOM };
  useLayoutEffect(() => {
    const context = canvas.current?.getContext("2d");
    if (!canvas.current || !context || !picture) return;
    const ratio = globalThis.devicePixelRatio || 1;
    [canvas.current.width, canvas.current.height] = [Math.round(inner.width * ratio), Math.round(inner.height * ratio)];
    draw(context, picture, canvas.current.width, canvas.current.height);
  });
  if (!picture) return <div class="chart analysis-chart" ref={host} />;
  const { x, y, scale } = picture;
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
      class="chart analysis-chart spectrogram"
      ref={host}
      onPointerMove={move}
      onPointerLeave={() => (pointer.value = undefined)}
    >
      <canvas
        ref={canvas}
        role="img"
        aria-label={TEXT.chart(TEXT.spectrogram, figures.signal)}
        style={{ left: `${LEFT}px`, top: `${TOP}px`, width: `${inner.width}px`, height: `${inner.height}px` }}
      />
      <svg width={width.value} height={HEIGHT} aria-hidden="true">
        <text class="title" x={LEFT} y={14}>
          {figures.signal} · {TEXT.overTime}
        </text>
        <g transform={`translate(${LEFT} ${TOP})`}>
          {ticks(y, Math.max(2, Math.floor(inner.height / 34))).map((tick) => (
            <text key={tick.text} x={-8} y={(1 - tick.at) * inner.height} dy="0.32em" text-anchor="end">
              {tick.text}
            </text>
          ))}
          {timeTicks(x, inner.width).map(({ t, text }) => (
            <text key={t} x={share(x, t) * inner.width} y={inner.height + 16} text-anchor="middle">
              {text}
            </text>
          ))}
        </g>
        <ColourBar scale={scale} unit={unit} right={width.value - RIGHT} />
      </svg>
      <Reading picture={picture} unit={unit} at={at} />
    </div>
  );
}

/** Labels of a time axis, at round seconds or their parts. */
function timeTicks(x: Axis, width: number): readonly { readonly t: number; readonly text: string }[] {
  const base = Math.floor(x.low);
  const relative = { kind: "linear", low: x.low - base, high: x.high - base } as const;
  const most = Math.max(2, Math.floor(width / LABEL_PX));
  const span = x.high - x.low;
  const decimals = span / most < 0.2 ? 2 : span / most < 1 ? 1 : 0;
  return ticks(relative, most).map(({ at }) => {
    const t = valueAtShare(x, at);
    return { t, text: clock(t + 1e-6, decimals) };
  });
}

function ColourBar({ scale, unit, right }: { readonly scale: Scale; readonly unit: string; readonly right: number }) {
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
    <p class="analysis-reading">
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
