/** An alignment as angles and "upside down", with the sensor drawn as it turns, beside the numbers that the device stores. */
import type { Vector3 } from "../data/rotations";
import { late } from "../ui/dom/late";
import type { FieldForm } from "../wire/form-types";
import { elementsOf, isUpsideDown, type Turn, turnedOver, turnOf } from "./alignment";
import type { FormContext } from "./form-context";
import { type InputProps, VectorInput } from "./inputs";
import { at, type Path, put } from "./values";
import { TEXT } from "../texts/forms";

const TurnPicture = late(() => import("../attitude/turn-picture").then((code) => code.TurnPicture));

interface Stored {
  readonly turn: Turn | undefined;
  readonly isRead: boolean;
  readonly set: (angles: Vector3) => void;
}

/** The alignment whose elements are at these paths. */
function stored(sheet: FormContext, paths: readonly Path[], scale: number): Stored {
  const wire = paths.map((path) => at(sheet.values, path));
  return {
    turn: turnOf(wire.map((one) => (typeof one === "number" ? one * scale : one))),
    isRead: !wire.includes(undefined),
    set: (angles) => {
      const next = elementsOf(angles, paths.length);
      sheet.set(
        [],
        paths.reduce((values, path, i) => put(values, path, (next[i] ?? 0) / scale), sheet.values),
      );
    },
  };
}

/** Angles that the device stores itself. */
export function AngledField(props: InputProps) {
  const { sheet, field, path } = props;
  const alignment = stored(
    sheet,
    [0, 1, 2].map((i) => [...path, i]),
    field.scale,
  );
  return (
    <div class="alignment">
      <div>
        <VectorInput {...props} />
        <UpsideDown {...alignment} isLocked={sheet.readOnly || field.read_only} />
      </div>
      {alignment.isRead && <TurnPicture axes={sheet.axes} turn={alignment.turn} />}
    </div>
  );
}

interface QuaternionProps {
  readonly sheet: FormContext;
  readonly fields: readonly FieldForm[];
  readonly root: Path;
}

/** Angles of a quaternion whose elements are fields of their own. */
export function AngledQuaternion({ sheet, fields, root }: QuaternionProps) {
  const [first] = fields;
  if (!first) return null;
  const alignment = stored(
    sheet,
    fields.map(({ name }) => [...root, name]),
    1,
  );
  const { turn, set } = alignment;
  const angles: FormContext = {
    ...sheet,
    values: { angles: turn?.angles },
    set: ([, place], value) => {
      const next = (turn?.angles ?? [0, 0, 0]).map((angle, i) => (i === place ? Number(value) : angle));
      set(next as unknown as Vector3);
    },
  };
  return (
    <div class="field-row angles">
      <div class="field-name text-sm">
        <span>{TEXT.angles}</span>
        <p class="field-help dim text-xs">{TEXT.anglesHelp}</p>
      </div>
      <div class="field-input alignment">
        <div>
          <VectorInput sheet={angles} field={anglesLike(first)} path={["angles"]} />
          <UpsideDown {...alignment} isLocked={sheet.readOnly || first.read_only} />
        </div>
        {alignment.isRead && <TurnPicture axes={sheet.axes} turn={alignment.turn} />}
      </div>
    </div>
  );
}

/** The field of angles in ° in place of an element of a quaternion. */
const anglesLike = (element: FieldForm): FieldForm => ({
  ...element,
  name: "angles",
  title: TEXT.angles,
  editor: "vector",
  unit: "°",
  low: -360,
  high: 360,
  length: 3,
  decimals: 2,
  axes: [TEXT.rollAxis, TEXT.pitchAxis, TEXT.yawAxis],
});

function UpsideDown({ turn, set, isLocked }: Stored & { readonly isLocked: boolean }) {
  const isDown = turn && isUpsideDown(turn);
  return (
    <span class="segmented small" role="group" aria-label={TEXT.mountedAs}>
      {[false, true].map((down) => (
        <button
          key={String(down)}
          type="button"
          aria-pressed={isDown === down}
          disabled={isLocked || !turn}
          onClick={() => turn && isDown !== down && set(turnedOver(turn.angles))}
        >
          {down ? TEXT.upsideDown : TEXT.upright}
        </button>
      ))}
    </span>
  );
}
