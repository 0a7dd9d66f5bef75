/** The result of a calibration: figures, the residual before and after, bias and matrix. */
import { number } from "../../ui/format/format";
import type { CalibrationFigure, CalibrationReport, ResidualTrace, SensorCorrection } from "../../wire/routes";
import { Message } from "../../ui/controls/message";
import { TEXT } from "./texts";

const WIDTH = 600;
const HEIGHT = 150;
const AXES = ["x", "y", "z"];

export function CalibrationResult({
  report,
  correction,
}: {
  readonly report: CalibrationReport;
  readonly correction: SensorCorrection;
}) {
  // as many decimals as the least certain axis has sense for
  const [hasMatrix, hasBias] = [!isIdentity(correction.matrix), correction.bias.some((value) => value !== 0)];
  const decimals = decimalsFor(Math.max(...correction.bias_uncertainty));
  return (
    <section class="calibration-result" aria-label={TEXT.result}>
      <dl class="calibration-figures">
        {lines(report.figures).map(({ title, words }) => (
          <div key={title}>
            <dt>{title}</dt>
            <dd>{words}</dd>
          </div>
        ))}
      </dl>
      {report.trace && <Trace trace={report.trace} />}
      <div class="calibration-numbers flex-wrap">
        {hasBias && (
          <table>
            <caption>
              {TEXT.bias}
              <span class="unit">{correction.unit}</span>
            </caption>
            <tbody>
              {AXES.map((axis, k) => (
                <tr key={axis}>
                  <th scope="row" class={`axis-${axis}`}>
                    {axis}
                  </th>
                  <td>{number(correction.bias[k], decimals)}</td>
                  <td class="dim">± {number(correction.bias_uncertainty[k], decimals)}</td>
                </tr>
              ))}
            </tbody>
          </table>
        )}
        {hasMatrix && (
          <table>
            <caption>{TEXT.matrix}</caption>
            <tbody>
              {correction.matrix.map((row, i) => (
                <tr key={AXES[i]}>
                  {row.map((cell, j) => (
                    <td key={AXES[j]}>{number(cell, 5)}</td>
                  ))}
                </tr>
              ))}
            </tbody>
          </table>
        )}
      </div>
      {correction.presupposes && <p>{correction.presupposes}</p>}
      <p class="mono dim">{TEXT.equation(hasMatrix, hasBias)}</p>
      <ul class="bullets">
        {report.notes.map((note) => (
          <li key={note}>
            <Message text={note} />
          </li>
        ))}
      </ul>
    </section>
  );
}

/** Figures in words; one without a title belongs to the one before: "17.8 µT · 31.7 %". */
function lines(figures: readonly CalibrationFigure[]): readonly { readonly title: string; readonly words: string }[] {
  const found: { title: string; words: string }[] = [];
  for (const figure of figures) {
    const words = `${valueOf(figure)}${figure.unit === "°" ? "" : " "}${figure.unit}`.trim();
    const last = found.at(-1);
    if (figure.title === "" && last) last.words += ` · ${words}`;
    else found.push({ title: figure.title, words });
  }
  return found;
}

/** A count as it is; a value with an uncertainty with the decimals of that; else three digits. */
function valueOf({ value, uncertainty, unit }: CalibrationFigure): string {
  if (unit === "" && Number.isInteger(value)) return number(value, 0);
  if (uncertainty === null) return digits(value);
  const decimals = decimalsFor(uncertainty);
  return `${number(value, decimals)} ± ${number(uncertainty, decimals)}`;
}

/** Decimals that show two digits of an uncertainty. */
function decimalsFor(sigma: number): number {
  return sigma > 0 ? Math.max(0, Math.min(9, 1 - Math.floor(Math.log10(sigma)))) : 5;
}

function isIdentity(matrix: readonly (readonly number[])[]): boolean {
  return matrix.every((row, i) => row.every((cell, j) => cell === (i === j ? 1 : 0)));
}

/** A number with so many digits that count. */
export function digits(value: number | undefined, count = 3): string {
  if (value === undefined || !Number.isFinite(value)) return number(undefined, 0);
  if (value === 0) return "0";
  return number(value, Math.max(0, Math.min(9, count - 1 - Math.floor(Math.log10(Math.abs(value))))));
}

function Trace({ trace }: { readonly trace: ResidualTrace }) {
  const all = [...trace.before, ...trace.after, trace.target];
  const [low, high] = [Math.min(...all), Math.max(...all)];
  const room = (high - low) * 0.06 || 1;
  const y = (value: number): number => HEIGHT - ((value - low + room) / (high - low + 2 * room)) * HEIGHT;
  const path = (values: readonly number[]): string =>
    values
      .map((value, k) => `${((k / Math.max(1, values.length - 1)) * WIDTH).toFixed(1)},${y(value).toFixed(1)}`)
      .join(" ");
  return (
    <figure class="calibration-trace">
      <figcaption>
        {TEXT.trace(trace.title)}
        <span class="unit">{trace.unit}</span>
        <span class="trace-legend">
          <i class="before" /> {TEXT.before} <i class="after" /> {TEXT.after}
        </span>
      </figcaption>
      <div>
        <svg
          viewBox={`0 0 ${WIDTH} ${HEIGHT}`}
          preserveAspectRatio="none"
          role="img"
          aria-label={TEXT.trace(trace.title)}
        >
          <line x1={0} x2={WIDTH} y1={y(trace.target)} y2={y(trace.target)} />
          <polyline class="before" points={path(trace.before)} />
          <polyline class="after" points={path(trace.after)} />
        </svg>
        <span class="high">{digits(high, 3)}</span>
        <span class="low">{digits(low, 3)}</span>
      </div>
    </figure>
  );
}
