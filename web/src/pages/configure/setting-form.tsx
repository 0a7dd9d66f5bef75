/** One setting as a form: its description, its fields, the server's answer, the bytes to be sent. */
import { useEffect } from "preact/hooks";
import { BudgetBar } from "../../forms/budget-bar";
import { BytesView } from "../../forms/frame-view";
import { changesOf, touches, type Present } from "../../forms/edits";
import { FieldList } from "../../forms/field";
import { RateTableEditor } from "../../forms/rate-table-editor";
import type { FormContext } from "../../forms/form-context";
import type { FieldForm, FieldProblem, LoadInfo, SettingForm, TextList } from "../../wire/form-types";
import type { Path, FormValues } from "../../forms/values";
import { Button } from "../../ui/controls/button";
import { Message } from "../../ui/controls/message";
import { ProblemNote } from "../../requests/problem-note";
import { route } from "../../page/route";
import type { Model } from "./model";
import { CAUTIONS, pauseOf } from "./view-state";
import { isViewOnly } from "../../wire/capabilities";
import { TEXT } from "../../texts/configure";
import { configureApi } from "./api";

interface Props {
  readonly model: Model;
  readonly form: SettingForm;
  /** It has the page for itself: its title stands above, its bytes are shown also without a change. */
  readonly alone: boolean;
}

const EFFECT: Readonly<Record<SettingForm["after"], string>> = {
  "": "",
  measurement: TEXT.effectAfterMeasurement,
  reset: TEXT.effectAfterRestart,
};

export function Setting({ model, form, alone }: Props) {
  const edits = model.counts.value.get(form.name) ?? 0;
  const lacking = model.body.value?.missing[form.name];
  const unread = model.present.value[form.name] === undefined;
  const showsBytes = alone || edits > 0 || form.table !== null;
  // biome-ignore lint/correctness/useExhaustiveDependencies: a preview belongs to the form, which is listed
  useEffect(() => {
    if (!showsBytes) return undefined;
    model.asking.request(form.name, 0);
    if (form.table) model.asking.request(`=${form.name}`, 0);
    return () => {
      model.asking.forget(form.name);
      model.asking.forget(`=${form.name}`);
    };
  }, [form, showsBytes]);
  return (
    <section class={`setting ${edits > 0 ? "edited" : ""}`} aria-label={form.title} data-setting={form.name}>
      {!alone && (
        <div class="setting-head">
          <h2>{form.title}</h2>
          <span class="dim mono ellipsis">{form.name}</span>
          <span class="grow" />
          <Discard model={model} form={form} edits={edits} />
        </div>
      )}
      <Words form={form} source={!alone} />
      {unread && <p class="hint inset unread">{TEXT.readAgainHint(unreadWords(lacking), pauseOf(model))}</p>}
      <Body model={model} form={form} />
      {showsBytes && <Consequences model={model} form={form} />}
    </section>
  );
}

/** Why a form does not show the device's values. */
function unreadWords(why: string | undefined): string {
  if (why === undefined) return TEXT.notReadFromDevice;
  return why.startsWith("not ") ? `${why.charAt(0).toUpperCase()}${why.slice(1)}.` : TEXT.notReadFromThisDevice(why);
}

export function Discard({
  model,
  form,
  edits,
}: {
  readonly model: Model;
  readonly form: SettingForm;
  readonly edits: number;
}) {
  return edits > 0 ? (
    <Button look="small" icon="undo" words={TEXT.discardChanges(edits)} onClick={() => model.discard(form.name)} />
  ) : null;
}

/** Problems of no field that is shown. */
export function LooseProblems({ problems }: { readonly problems: readonly FieldProblem[] }) {
  return problems.map((problem) => <ProblemNote key={problem.path} class="inset" problem={problem} />);
}

/** Purpose, time of effect and possible harm. */
export function Words({
  form,
  source = false,
}: {
  readonly source?: boolean;
  readonly form: Pick<SettingForm, "doc" | "source" | "caution" | "consequence"> & {
    readonly after?: SettingForm["after"];
  };
}) {
  const effect = EFFECT[form.after ?? ""];
  return (
    <div class="setting-words">
      {(form.doc || effect) && (
        <p>
          {form.doc} {effect} {source && form.source !== "" && <span class="dim source">{form.source}</span>}
        </p>
      )}
      {form.caution !== "" && (
        <p class="caution">
          <span class="tag warn">▲ {CAUTIONS[form.caution]}</span> {form.consequence}
        </p>
      )}
    </div>
  );
}

export function sheetOf(model: Model, form: SettingForm): FormContext {
  return {
    id: `set-${form.name}`,
    values: model.valuesOf(form),
    before: model.present.value[form.name],
    problems: model.previews.value[form.name]?.problems ?? [],
    readOnly: !form.writable || isViewOnly.value,
    all: model.page.all.value,
    set: (path: Path, value: unknown) => model.edit(form, path, value),
    wrong: (path: Path, why: string | undefined) => model.setWrong(form.name, path, why),
    hover: (path: string) => (model.hot.value = path),
    options: optionsOf(form, model.present.value),
    sought: route.value.place === form.name ? (route.value.more ?? "") : "",
    axes: model.forms.value?.axes ?? "FLU",
    ports: inside(form.name, model.body.value?.ports ?? []),
    epoch: model.epochs.value[form.name] ?? 0,
  };
}

/** What lies in a setting, as paths in it. */
const inside = (setting: string, paths: readonly string[]): readonly string[] =>
  paths.flatMap((path) => (path.startsWith(`${setting}.`) ? [path.slice(setting.length + 1)] : []));

function Body({ model, form }: { readonly model: Model; readonly form: SettingForm }) {
  const sheet = sheetOf(model, form);
  const { table } = form;
  const list: FieldForm | undefined = form.fields.find(({ editor }) => editor === "list");
  if (table === null || list === undefined) return <FieldList sheet={sheet} fields={form.fields} />;
  if (!model.isKnown(form)) return null; // an empty table would suggest that nothing is sent
  const load = model.loadOf(form.name) ?? model.loadOf(`=${form.name}`);
  const rest = form.fields.filter((field) => field !== list);
  return (
    <>
      <RateTableEditor sheet={sheet} field={list} table={table} load={load} hot={model.hot.value} />
      {rest.length > 0 && <FieldList sheet={sheet} fields={rest} />}
    </>
  );
}

/** Load, line, bytes. */
function Consequences({ model, form }: { readonly model: Model; readonly form: SettingForm }) {
  const preview = model.previews.value[form.name];
  const before: FormValues | undefined = model.present.value[form.name];
  const found = changesOf(form, before, model.valuesOf(form));
  const changed = (path: string): boolean =>
    path !== "" &&
    before !== undefined &&
    touches(
      found,
      path.split(".").map((part) => (/^\d+$/.test(part) ? Number(part) : part)),
    );
  const load: LoadInfo | null = model.loadOf(form.name) ?? (form.table ? model.loadOf(`=${form.name}`) : null);
  const loose = (preview?.problems ?? []).filter(
    ({ path }) => !form.fields.some(({ name }) => path === name || path.startsWith(`${name}.`)),
  );
  const hover = (path: string): void => {
    model.hot.value = path;
  };
  return (
    <>
      {(form.table || (preview?.line && preview.load)) && load && (
        <BudgetBar
          load={load}
          before={model.loadOf(`=${form.name}`)}
          baud={model.baud.value}
          rates={model.rates.value}
          changed={changed}
          hot={model.hot.value}
          hover={hover}
        >
          {form.table && (
            <Button
              changes
              look="edge small"
              icon="wand"
              words={TEXT.makeFit}
              disabled={model.capacity(load) === null}
              onClick={() => void makeItFit(model, form)}
            />
          )}
        </BudgetBar>
      )}
      {form.table && <FitWords model={model} form={form} />}
      {preview?.line && (
        <p class="caution inset">
          <span class="tag warn">{TEXT.temporary}</span> {preview.line}
        </p>
      )}
      {preview?.risks?.map((words) => (
        <p class="caution inset" key={words}>
          ▲ <Message text={words} />
        </p>
      ))}
      <LooseProblems problems={loose} />
      {preview && <BytesView frames={preview.frames} changed={changed} hot={model.hot.value} hover={hover} />}
    </>
  );
}

/** Result of "Fit to link" in words, until the next edit. */
function FitWords({ model, form }: { readonly model: Model; readonly form: SettingForm }) {
  const fit = model.fitting.value;
  if (fit === undefined || fit.setting !== form.name || fit.draft !== model.drafts.value[form.name]) return null;
  return (
    <div class="fit-words hint inset" role="status">
      <b>{fit.words.length === 0 ? TEXT.fits : TEXT.loweredToFit}</b>
      <ul>
        {fit.words.map((words) => (
          <li key={words}>{words}</li>
        ))}
      </ul>
    </div>
  );
}

/** Options of the fields of a setting, by name; fields that may hold any text are not in it. */
export function optionsOf(form: SettingForm, present: Present): Readonly<Record<string, readonly string[]>> {
  const found = form.fields.flatMap((field) => {
    const options = field.listed ? listed(field.options, textsOf(field.listed, present)) : field.options;
    return field.editor === "text" && options.length > 0 ? [[field.name, options] as const] : [];
  });
  return Object.fromEntries(found);
}

/** The texts that the device listed. */
function textsOf({ setting, records, text, used }: TextList, present: Present): readonly string[] {
  const rows = present[setting]?.[records];
  return Array.isArray(rows)
    ? rows
        .filter((row) => Number(row[used]) > 0)
        .map((row) => String(row[text]).trim())
        .filter(Boolean)
    : [];
}

/** Options all of whose parts the device lists ("Robust/VRU" of Robust and VRU), then what it lists beyond them. */
function listed(options: readonly string[], texts: readonly string[]): readonly string[] {
  if (texts.length === 0) return options;
  const parts = new Set(options.flatMap((option) => option.split("/")));
  const there = options.filter((option) => option.split("/").every((part) => texts.includes(part)));
  return [...there, ...texts.filter((text) => !parts.has(text))];
}

async function makeItFit(model: Model, form: SettingForm): Promise<void> {
  const answer = await model.run(configureApi.fit(model.id, form.name, model.valuesOf(form), model.baud.value ?? null));
  if (answer === undefined) return;
  for (const field of form.fields) {
    const value = answer.values[field.name];
    if (value !== undefined && !field.read_only) model.edit(form, [field.name], value);
  }
  model.fitting.value = { setting: form.name, words: answer.words, draft: model.drafts.peek()[form.name] };
}
