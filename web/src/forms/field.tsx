/** A field of a form: its name and meaning, its input, its range, what it was. Records and lists are drawn from the fields inside them. */
import { Message } from "../ui/message";
import { words as named } from "../ui/labels";
import { wasAt } from "./edits";
import { BoolInput, ChoiceInput, FlagsInput, type InputProps, NumberInput, OptionInput, TextInput, VectorInput } from "./inputs";
import { ListInput } from "./list-input";
import { idOf, problemAt, type Sheet } from "./form-context";
import type { FieldForm } from "./types";
import { joined, type Path, rangeWords, words } from "./values";

/** Which fields are shown: simple ones, those that were changed or are wrong, and all where a person asked for all. */
export function shownFields(fields: readonly FieldForm[], sheet: Sheet, root: Path = []): readonly FieldForm[] {
  if (sheet.all || fields.every(({ simple }) => !simple)) return fields;
  return fields.filter((field) => {
    const path = [...root, field.name];
    return field.simple || (root.length === 0 && field.name === sheet.sought) || wasAt(sheet.before, sheet.values, path) !== undefined || problemAt(sheet, path) !== undefined;
  });
}

interface FieldsProps {
  readonly sheet: Sheet;
  readonly fields: readonly FieldForm[];
  readonly root?: Path;
}

export function Fields({ sheet, fields, root = [] }: FieldsProps) {
  return (
    <div class="fields">
      {shownFields(fields, sheet, root).map((field) => (
        <Field key={field.name} sheet={sheet} field={field} path={[...root, field.name]} />
      ))}
    </div>
  );
}

/** Editors that are one control, which a label can name. */
const SINGLE = new Set(["number", "integer", "choice", "text", "hex"]);

export function Field({ sheet, field, path }: InputProps) {
  const was = wasAt(sheet.before, sheet.values, path);
  const problem = problemAt(sheet, path);
  const id = idOf(sheet, path);
  const title = titleOf(field);
  const row = joined(path);
  const range = field.editor === "number" || field.editor === "integer" || field.editor === "vector" ? rangeWords(field) : "";
  const isBlock = field.editor === "list" || field.editor === "record";
  return (
    <div
      class={`frow ${was === undefined ? "" : "ch"} ${isBlock ? "block" : ""}`}
      data-field={field.name}
      onPointerEnter={() => sheet.hover(row)}
      onPointerLeave={() => sheet.hover("")}
      onFocusCapture={() => sheet.hover(row)}
    >
      <div class="fname">
        {SINGLE.has(field.editor) ? <label for={id}>{title}</label> : <span>{title}</span>}
        {field.read_only && <span class="tag">read-only</span>}
        {field.doc !== "" && (
          <p class="fdoc" id={`${id}-doc`}>
            {field.doc}
          </p>
        )}
      </div>
      <div class="fin">
        <Editor sheet={sheet} field={field} path={path} describedBy={field.doc ? `${id}-doc` : undefined} />
        {was !== undefined && !isBlock && <span class="was">was {words(field, was)}</span>}
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

/** Titles are written by people; bare names are read as words. */
export function titleOf(field: FieldForm): string {
  return field.title === field.name ? named(field.name.split(".").map((part) => part.charAt(0).toUpperCase() + part.slice(1)).join(" · ")) : field.title;
}

/** The input of a field, without its words. */
export function Editor(props: InputProps) {
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
      return <VectorInput {...props} />;
    case "list":
      return <ListInput {...props} />;
    case "record":
      return <Fields sheet={sheet} fields={field.fields} root={path} />;
    case "number":
    case "integer":
      return <NumberInput {...props} />;
  }
}
