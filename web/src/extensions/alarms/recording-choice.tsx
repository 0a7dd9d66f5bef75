/** The recording of an alarm, in its form: whether it starts one, from how long before to how long after, and its bounds. */
import type { RecordingAction } from "../../wire/routes";
import { TEXT } from "./texts";
import { OptionList } from "../../ui/controls/choices";

/** The fields of a recording, as typed. */
export interface RecordingFields {
  readonly before: string;
  readonly after: string;
  readonly longest: string;
  readonly perHour: string;
  readonly everyDevice: boolean;
}

const USUAL: Required<RecordingAction> = {
  before_s: 10,
  after_s: 10,
  longest_s: 600,
  per_hour: 6,
  every_device: false,
};

export function recordingFieldsOf(action: RecordingAction | null | undefined): RecordingFields | undefined {
  if (!action) return undefined;
  const { before_s, after_s, longest_s, per_hour, every_device } = { ...USUAL, ...action };
  return {
    before: String(before_s),
    after: String(after_s),
    longest: String(longest_s),
    perHour: String(per_hour),
    everyDevice: every_device,
  };
}

export function recordingOf(fields: RecordingFields | undefined): RecordingAction | null {
  if (fields === undefined) return null;
  return {
    before_s: numberOr(fields.before, 0),
    after_s: numberOr(fields.after, 0),
    longest_s: numberOr(fields.longest, USUAL.longest_s),
    per_hour: numberOr(fields.perHour, USUAL.per_hour),
    every_device: fields.everyDevice,
  };
}

const numberOr = (text: string, otherwise: number): number => (text.trim() === "" ? otherwise : Number(text));

interface Props {
  readonly fields: RecordingFields | undefined;
  readonly onFields: (fields: RecordingFields | undefined) => void;
}

/** Whose bytes are recorded; none, then there is no recording. */
type Scope = "" | "device" | "every";

export function RecordingChoice({ fields, onFields }: Props) {
  const scope: Scope = fields === undefined ? "" : fields.everyDevice ? "every" : "device";
  const choose = (chosen: Scope): void => {
    const before = fields ?? recordingFieldsOf(USUAL);
    onFields(chosen === "" || before === undefined ? undefined : { ...before, everyDevice: chosen === "every" });
  };
  const set = (change: Partial<RecordingFields>): void => {
    if (fields !== undefined) onFields({ ...fields, ...change });
  };
  return (
    <>
      <label>
        {TEXT.recording}
        <OptionList
          value={scope}
          options={[
            ["", TEXT.noRecording],
            ["device", TEXT.recordDevice],
            ["every", TEXT.recordEveryDevice],
          ]}
          onChoose={choose}
        />
      </label>
      {fields !== undefined && (
        <>
          <NumberField
            title={TEXT.recordBefore}
            value={fields.before}
            max={3600}
            onValue={(before) => set({ before })}
          />
          <NumberField title={TEXT.recordAfter} value={fields.after} max={3600} onValue={(after) => set({ after })} />
          <NumberField
            title={TEXT.recordLongest}
            value={fields.longest}
            min={1}
            max={86400}
            onValue={(longest) => set({ longest })}
          />
          <NumberField
            title={TEXT.recordPerHour}
            value={fields.perHour}
            min={1}
            max={60}
            step={1}
            onValue={(perHour) => set({ perHour })}
          />
        </>
      )}
    </>
  );
}

interface NumberProps {
  readonly title: string;
  readonly value: string;
  readonly min?: number;
  readonly max?: number;
  readonly step?: number | "any";
  readonly onValue: (value: string) => void;
}

export function NumberField({ title, value, min = 0, max, step = "any", onValue }: NumberProps) {
  return (
    <label>
      {title}
      <input
        type="number"
        min={min}
        max={max}
        step={step}
        value={value}
        onInput={(event) => onValue(event.currentTarget.value)}
      />
    </label>
  );
}
