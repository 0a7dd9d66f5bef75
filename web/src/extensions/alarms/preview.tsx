/** How often an alarm would have been raised by the samples in memory or of an open recording, and when, in the form while it is filled in. */
import { Button } from "../../ui/controls/button";
import { clock, number, span } from "../../ui/format/format";
import { request } from "../../requests/http";
import { Answered, useAnswer } from "../../requests/use-answer";
import type { AlarmDefinition, AlarmPreview as Preview } from "../../wire/routes";
import { TEXT } from "./texts";

/** Stretch of the past, s. */
const PREVIEW_S = 600;
/** Times that are listed. */
const MAX_LISTED = 5;

/** The open recording that an alarm is judged over. */
export interface PreviewPlace {
  /** Id of its device. */
  readonly device: string;
  /** Shows a moment of it. */
  readonly show: (time: number) => void;
}

interface Props {
  /** The definition as JSON; undefined while it is not valid. */
  readonly stamp: string | undefined;
  /** Id of the live device, or of the recording. */
  readonly source: string | undefined;
  readonly recorded?: PreviewPlace | undefined;
}

export function PreviewNote({ stamp, source, recorded }: Props) {
  const device = recorded?.device;
  const definition = stamp === undefined ? undefined : (JSON.parse(stamp) as AlarmDefinition);
  const canAsk = definition !== undefined && source !== undefined && definition.condition.kind !== "health";
  // a definition that cannot be judged has no result
  const question = canAsk ? JSON.stringify([stamp, source, device]) : "";
  const found = useAnswer(question, (signal) =>
    request("POST /api/alarms/preview", {
      body: {
        definition: definition as AlarmDefinition,
        source: source ?? "",
        ...(device === undefined ? { seconds: PREVIEW_S } : { device }),
      },
      signal,
    }),
  );
  return (
    <div role="status">
      <Answered of={found}>{(preview) => <Times preview={preview} recorded={recorded} />}</Answered>
    </div>
  );
}

function Times({ preview, recorded }: { readonly preview: Preview } & Pick<Props, "recorded">) {
  const shown = preview.intervals.slice(0, MAX_LISTED);
  const more = preview.times - shown.length;
  return (
    <>
      <p class="alarm-note mid text-xs">{previewWords(preview, recorded !== undefined)}</p>
      {recorded && shown.length > 0 && (
        <ul class="alarm-times flex-wrap text-sm" aria-label={TEXT.raisedAt}>
          {shown.map(({ t0, t1, worst }) => {
            const long = span((t1 ?? t0) - t0);
            return (
              <li key={t0}>
                <Button
                  look="small edge"
                  words={clock(t0, 3)}
                  title={TEXT.showInPlots}
                  onClick={() => recorded.show(t0)}
                />{" "}
                <span class="dim">
                  {TEXT.lasted(`${long.value} ${long.unit}`, worst === null ? "" : withUnit(worst, preview.unit))}
                </span>
              </li>
            );
          })}
          {more > 0 && <li class="dim">{TEXT.moreTimes(more)}</li>}
        </ul>
      )}
    </>
  );
}

const withUnit = (value: number, unit: string): string => `${number(value, 3)} ${unit}`.trim();

/** The sentence for a preview; "" without samples. */
export function previewWords({ times, t0, t1, worst, unit }: Preview, isRecorded = false): string {
  if (t0 === null || t1 === null) return "";
  const stretch = span(t1 - t0);
  const past = isRecorded ? TEXT.inRecording : TEXT.inTheLast(`${stretch.value} ${stretch.unit}`);
  if (times === 0) return TEXT.wouldNotRaise(past);
  return TEXT.wouldRaise(times, past, worst === null ? "" : withUnit(worst, unit));
}
