/** A chart drawn as SVG: its size, its grid and titles, and the place of a pointer in it. What is drawn in it is given. */
import type { ComponentChildren, RefObject } from "preact";
import { useRef } from "preact/hooks";
import { type Axis, type Tick, valueAtShare } from "./axes";
import { type ChartArea, Grid } from "./grid";
import { useHeight, useWidth } from "./use-size";

export interface ChartSize extends ChartArea {
  readonly host: RefObject<HTMLDivElement | null>;
  /** Room of figures and titles around the area, px. */
  readonly margins: { readonly left: number; readonly right: number; readonly top: number; readonly bottom: number };
  readonly area: ChartArea;
}

/** Class of the element around a chart, beside one of its own. */
export const chartClass = (own: string): string => `chart ${own}`;

/** @param high px; default: as high as its place */
export function useChart(margins: ChartSize["margins"], high?: number): ChartSize {
  const host = useRef<HTMLDivElement>(null);
  const [{ value: width }, place] = [useWidth(host), useHeight(host)];
  const height = high ?? place.value;
  const { left, right, top, bottom } = margins;
  return { host, margins, width, height, area: { width: width - left - right, height: height - top - bottom } };
}

/** Place of a pointer in the area, px; NaN while there is no chart. */
export function pointIn(
  { host, margins }: ChartSize,
  { clientX, clientY }: { readonly clientX: number; readonly clientY: number },
): readonly [x: number, y: number] {
  const box = host.current?.getBoundingClientRect();
  return box ? [clientX - box.left - margins.left, clientY - box.top - margins.top] : [NaN, NaN];
}

/** The value under a pointer; undefined outside the area. */
export function valueUnder(size: ChartSize, x: Axis | undefined, event: PointerEvent): number | undefined {
  const at = pointIn(size, event)[0] / size.area.width;
  return x && at >= 0 && at <= 1 ? valueAtShare(x, at) : undefined;
}

interface ChartProps {
  readonly size: ChartSize;
  /** What it shows; default: its element says it. */
  readonly label?: string;
  readonly x: Axis | readonly Tick[];
  readonly y: Axis | undefined;
  readonly room?: readonly [number, number];
  readonly xTitle?: string;
  readonly xTitleAt?: "middle" | "end";
  readonly yTitle: string;
  /** px from the left. */
  readonly yTitleX?: number;
  readonly children: ComponentChildren;
}

export function Chart({
  size,
  label,
  x,
  y,
  room,
  xTitle,
  xTitleAt = "middle",
  yTitle,
  yTitleX = 4,
  children,
}: ChartProps) {
  const { width, height, margins, area } = size;
  const named = label === undefined ? { "aria-hidden": true as const } : { role: "img" as const, "aria-label": label };
  return (
    <svg {...named} width={width} height={height}>
      <g transform={`translate(${margins.left} ${margins.top})`}>
        {y && <Grid x={x} y={y} {...(room ? { room } : {})} {...area} />}
        {children}
      </g>
      {xTitle !== undefined && (
        <text
          class="chart-title"
          x={margins.left + area.width / (xTitleAt === "middle" ? 2 : 1)}
          y={height - 4}
          text-anchor={xTitleAt}
        >
          {xTitle}
        </text>
      )}
      <text class="chart-title" x={yTitleX} y={12}>
        {yTitle}
      </text>
    </svg>
  );
}
