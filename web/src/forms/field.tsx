/** A field of a form: name, help, input, range, previous value. Records and lists are drawn from the fields inside them. */
import { Message } from "../ui/controls/message";
import { labelWords as named } from "../ui/format/labels";
import { hasAngles, quaternionOf } from "./alignment";
import { wasAt } from "./edits";
import {
  BoolInput,
  ChoiceInput,
  FlagsInput,
  type InputProps,
  NumberInput,
  OptionInput,
  TextInput,
  VectorInput,
} from "./inputs";
import { ListInput } from "./list-input";
import { AngledField, AngledQuaternion } from "./alignment-input";
import { idOf, problemAt, type FormContext } from "./form-context";
import type { FieldForm } from "../wire/form-types";
import { joined, ownRangeWords, type Path, valueWords } from "./values";
import { COMMON } from "../texts/common";
import { TEXT } from "../texts/forms";

/** Fields to show: basic ones, changed or wrong ones, and all on request. */
export function shownFields(fields: readonly FieldForm[], sheet: FormContext, root: Path = []): readonly FieldForm[] {
  if (sheet.all || fields.every(({ basic }) => !basic)) return fields;
  return fields.filter((field) => {
    const path = [...root, field.name];
    return (
      field.basic ||
      (root.length === 0 && field.name === sheet.sought) ||
      wasAt(sheet.before, sheet.values, path) !== undefined ||
      problemAt(sheet, path) !== undefined
    );
  });
}

interface FieldsProps {
  readonly sheet: FormContext;
  readonly fields: readonly FieldForm[];
  readonly root?: Path;
}

export function FieldList({ sheet, fields, root = [] }: FieldsProps) {
  const quaternion = quaternionOf(fields);
  return (
    <div class="fields">
      {quaternion.length > 0 && <AngledQuaternion sheet={sheet} fields={quaternion} root={root} />}
      {shownFields(fields, sheet, root).map((field) => (
        <Field key={field.name} sheet={sheet} field={field} path={[...root, field.name]} />
      ))}
    </div>
  );
}

/** Editors with a single control, which a label can name. */
const SINGLE = new Set(["number", "integer", "choice", "text", "hex"]);

export function Field({ sheet, field, path }: InputProps) {
  const was = wasAt(sheet.before, sheet.values, path);
  const problem = problemAt(sheet, path);
  const id = idOf(sheet, path);
  const title = titleOf(field);
  const row = joined(path);
  const range =
    field.editor === "number" || field.editor === "integer" || field.editor === "vector" ? ownRangeWords(field) : "";
  const isBlock = field.editor === "list" || field.editor === "record";
  return (
    <div
      class={`field-row ${was === undefined ? "" : "changed"} ${isBlock ? "block" : ""}`}
      data-field={field.name}
      onPointerEnter={() => sheet.hover(row)}
      onPointerLeave={() => sheet.hover("")}
      onFocusCapture={() => sheet.hover(row)}
    >
      <div class="field-name text-sm">
        {SINGLE.has(field.editor) ? <label for={id}>{title}</label> : <span>{title}</span>}
        {field.read_only && <span class="tag">{COMMON.readOnly}</span>}
        <OwnPort sheet={sheet} path={path} />
        {field.doc !== "" && (
          <p class="field-help dim text-xs" id={`${id}-doc`}>
            {field.doc}
          </p>
        )}
      </div>
      <div class="field-input flex-row">
        <FieldEditor sheet={sheet} field={field} path={path} describedBy={field.doc ? `${id}-doc` : undefined} />
        {was !== undefined && was !== null && !isBlock && (
          <span class="previous">{TEXT.wasValue(valueWords(field, was))}</span>
        )}
        {range !== "" && !field.read_only && <span class="range">{range}</span>}
        {problem && (
          <span class="why-not" role="alert">
            <Message text={problem.message} /> <Message text={problem.hint} />
          </span>
        )}
      </div>
    </div>
  );
}

/** Marks the port that the link uses, or may use. */
export function OwnPort({ sheet: { ports }, path }: Pick<InputProps, "sheet" | "path">) {
  return ports.includes(joined(path)) ? (
    <span class="tag">{ports.length === 1 ? TEXT.thisLink : TEXT.perhapsThisLink}</span>
  ) : null;
}

/** Title of a field; bare names are converted to words. */
function titleOf(field: FieldForm): string {
  return field.title === field.name
    ? named(
        field.name
          .split(".")
          .map((part) => part.charAt(0).toUpperCase() + part.slice(1))
          .join(" · "),
      )
    : field.title;
}

/** The input of a field, without its label. */
export function FieldEditor(props: InputProps) {
  const { sheet, field, path } = props;
  const options = sheet.options[joined(path)];
  if (options !== undefined) return <OptionInput {...props} options={options} />;
  switch (field.editor) {
    case "choice":
      return <ChoiceInput {...props} />;
    case "flags":
      return <FlagsInput {...props} />;
    case "bool":
      return <BoolInput {...props} />;
    case "text":
    case "hex":
      return <TextInput {...props} />;
    case "vector":
      return hasAngles(field) ? <AngledField {...props} /> : <VectorInput {...props} />;
    case "list":
      return <ListInput {...props} />;
    case "record":
      return <FieldList sheet={sheet} fields={field.fields} root={path} />;
    case "number":
    case "integer":
      return <NumberInput {...props} />;
  }
}
