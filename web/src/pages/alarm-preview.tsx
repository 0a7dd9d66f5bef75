/** How often an alarm would have been raised by the samples in memory, in the form while it is filled in. */
import { useSignal } from "@preact/signals";
import { useEffect } from "preact/hooks";
import { number, span } from "../ui/format";
import { request } from "../ui/http";
import type { AlarmDefinition, AlarmPreview as Preview } from "../wire/routes";
import { TEXT } from "../texts/alarms";

/** Stretch of the past, s. */
const SECONDS = 600;

interface Props {
  /** The definition as JSON; undefined while it is not valid. */
  readonly stamp: string | undefined;
  /** Id of the live device. */
  readonly source: string | undefined;
}

export function AlarmPreview({ stamp, source }: Props) {
  const found = useSignal<Preview | undefined>(undefined);
  useEffect(() => {
    found.value = undefined;
    if (stamp === undefined || source === undefined) return undefined;
    const definition = JSON.parse(stamp) as AlarmDefinition;
    if (definition.condition.kind === "health") return undefined;
    const cancelled = new AbortController();
    const body = { definition, source, seconds: SECONDS };
    void request("POST /api/alarms/preview", { body, signal: cancelled.signal }).then((outcome) => {
      if (!cancelled.signal.aborted) found.value = outcome.ok ? outcome.value : undefined;
    });
    return () => cancelled.abort();
  }, [stamp, source, found]);
  return (
    <p class="alarm-note" role="status">
      {found.value && previewWords(found.value)}
    </p>
  );
}

/** The sentence for a preview; "" without samples. */
export function previewWords({ times, t0, t1, worst, unit }: Preview): string {
  if (t0 === null || t1 === null) return "";
  const stretch = span(t1 - t0);
  const past = `${stretch.value} ${stretch.unit}`;
  if (times === 0) return TEXT.wouldNotRaise(past);
  return TEXT.wouldRaise(times, past, worst === null ? "" : `${number(worst, 3)} ${unit}`.trim());
}
