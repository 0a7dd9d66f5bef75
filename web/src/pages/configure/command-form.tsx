/** One command as a form: its description, arguments, bytes, Send, and result. */
import { useEffect } from "preact/hooks";
import { BytesView } from "../../forms/frame-view";
import { FieldList } from "../../forms/field";
import type { FormContext } from "../../forms/form-context";
import type { CommandForm } from "../../wire/form-types";
import { type Path, valueWords as wordsOf } from "../../forms/values";
import { Button } from "../../ui/controls/button";
import { route } from "../../page/route";
import type { Model } from "./model";
import { configureApi } from "./api";
import { LooseProblems, Words } from "./setting-form";
import { JobLine } from "./jobs";
import { unfinishedOf } from "./view-state";
import { isViewOnly } from "../../wire/capabilities";
import { TEXT } from "../../texts/configure";

export function Command({ model, form }: { readonly model: Model; readonly form: CommandForm }) {
  const key = `!${form.name}`;
  // biome-ignore lint/correctness/useExhaustiveDependencies: a preview belongs to the values, which are listed
  useEffect(() => {
    model.asking.request(key, 0);
    return () => model.asking.forget(key);
  }, [form]);
  const preview = model.previews.value[key];
  const problems = preview?.problems ?? [];
  const sheet: FormContext = {
    id: `cmd-${form.name}`,
    values: model.argumentsOf(form),
    before: undefined,
    problems,
    readOnly: isViewOnly.value,
    all: model.page.all.value,
    set: (path: Path, value: unknown) => model.fill(form, path, value),
    wrong: (path: Path, why: string | undefined) => model.setWrong(key, path, why),
    hover: (path: string) => (model.hot.value = path),
    options: {},
    sought: route.value.place === form.name ? (route.value.more ?? "") : "",
    axes: model.forms.value?.axes ?? "FLU",
    ports: [],
    epoch: 0,
  };
  const isWrong = [...model.wrong.value.keys()].some((at) => at.startsWith(`${key}/`));
  const unread = form.writes !== "" && model.present.value[form.writes] === undefined;
  const blocked = isViewOnly.value
    ? TEXT.viewOnlyCommand
    : isWrong || problems.length > 0
      ? TEXT.invalidValues
      : unread
        ? TEXT.readBeforeCommand
        : "";
  const job = model.sent.value[form.name];
  const loose = problems.filter(
    ({ path }) => !form.arguments.some(({ name }) => path === name || path.startsWith(`${name}.`)),
  );
  return (
    <section class="setting" aria-label={form.title} data-command={form.name}>
      <Words form={form} />
      {form.arguments.length > 0 && <FieldList sheet={sheet} fields={form.arguments} />}
      <LooseProblems problems={loose} />
      <div class="send-row flex-row text-sm">
        <Button
          look={form.caution ? "edge" : "main"}
          icon="right"
          words={form.kind === "ask" ? TEXT.request : TEXT.send}
          disabled={blocked !== ""}
          onClick={() => void send(model, form)}
        />
        <span class="dim">{blocked || (form.reply ? TEXT.answeredBy(form.reply) : TEXT.noReply)}</span>
      </div>
      {job !== undefined && <JobLine model={model} id={job} />}
      {preview && (
        <BytesView
          frames={preview.frames}
          changed={() => false}
          hot={model.hot.value}
          hover={(path) => (model.hot.value = path)}
        />
      )}
    </section>
  );
}

/** Sends, after a confirmation that names the loss. Only the server knows what else is discarded: it is asked. */
async function send(model: Model, form: CommandForm, confirmed = false): Promise<void> {
  const values = model.argumentsOf(form);
  const shown = form.arguments
    .filter((field) => Object.keys(field.choices).length > 0 && values[field.name] !== undefined)
    .map((field) => `${field.title}: ${wordsOf(field, values[field.name])}`);
  const ask = (words: string): void => {
    model.page.question.value = {
      title: TEXT.confirmCommand(form.title),
      about: model.fullName,
      words: [words, ...shown],
      caution: form.caution || "loses-settings",
      go: TEXT.send,
      act: () => void send(model, form, true),
    };
  };
  const harms =
    form.caution !== "" && !Object.entries(form.harmless).some(([name, those]) => those.includes(Number(values[name])));
  if (!confirmed && harms && unfinishedOf(model).length === 0) return ask(form.consequence || TEXT.cannotBeUndone);
  model.page.wrote(model.id);
  const outcome = await configureApi.run(model.writeName, form.name, values, confirmed);
  if (!confirmed && !outcome.ok && outcome.problem.kind === "confirm") return ask(outcome.problem.message);
  const job = await model.run(Promise.resolve(outcome));
  if (job === undefined) return;
  model.sent.value = { ...model.sent.value, [form.name]: job.id };
  if (form.writes === "") return;
  const { [form.name]: _, ...others } = model.arguments.peek(); // shows the device's values from now on
  model.arguments.value = others;
}
