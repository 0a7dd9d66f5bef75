/** One command as a form: what it does, its arguments, its bytes, Send, and what came of it. */
import { useEffect } from "preact/hooks";
import { BytesView } from "../../forms/frame-view";
import { Fields } from "../../forms/field";
import type { Sheet } from "../../forms/form-context";
import type { CommandForm } from "../../forms/types";
import type { Path } from "../../forms/values";
import { Icon } from "../../ui/icons";
import { Message } from "../../ui/message";
import { type Model, viewOnly } from "./model";
import { server } from "./api";
import { Words } from "./setting-form";
import { JobLine } from "./jobs";
import { all, here, question, unfinishedOf } from "./view-state";

export function Command({ model, form }: { readonly model: Model; readonly form: CommandForm }) {
  const key = `!${form.name}`;
  useEffect(() => {
    model.preview(key, 0);
    return () => model.forget(key);
  }, [form]);
  const preview = model.previews.value[key];
  const problems = preview?.problems ?? [];
  const sheet: Sheet = {
    id: `cmd-${form.name}`,
    values: model.argumentsOf(form),
    before: undefined,
    problems,
    readOnly: viewOnly.value,
    all: all.value,
    set: (path: Path, value: unknown) => model.fill(form, path, value),
    wrong: (path: Path, why: string | undefined) => model.setWrong(key, path, why),
    hover: (path: string) => (model.hot.value = path),
    options: {},
    sought: here.value.place === form.name ? (here.value.more ?? "") : "",
    epoch: 0,
  };
  const isWrong = [...model.wrong.value.keys()].some((at) => at.startsWith(`${key}/`));
  const unread = form.writes !== "" && model.present.value[form.writes] === undefined;
  const blocked = viewOnly.value ? "View only: open this page with a control token to send." : isWrong || problems.length > 0 ? "Some of the values cannot be sent." : unread ? "Read the settings first: this form opens with what the device has." : "";
  const job = model.sent.value[form.name];
  const loose = problems.filter(({ path }) => !form.arguments.some(({ name }) => path === name || path.startsWith(`${name}.`)));
  return (
    <section class="setting" aria-label={form.title} data-command={form.name}>
      <Words form={form} />
      {form.arguments.length > 0 && <Fields sheet={sheet} fields={form.arguments} />}
      {loose.map(({ path, message, hint }) => (
        <p class="problem inset" role="alert" key={path}>
          <b><Message text={message} /></b> <Message text={hint} />
        </p>
      ))}
      <div class="sendrow">
        <button type="button" class={`btn ${form.caution ? "edge" : "main"}`} disabled={blocked !== ""} onClick={() => void send(model, form)}>
          <Icon name="right" />
          {form.kind === "ask" ? "Ask" : "Send"}
        </button>
        <span class="dim">{blocked || (form.reply ? `Answered by ${form.reply}.` : "Nothing answers it.")}</span>
      </div>
      {job !== undefined && <JobLine model={model} id={job} />}
      {preview && <BytesView frames={preview.frames} changed={() => false} hot={model.hot.value} hover={(path) => (model.hot.value = path)} />}
    </section>
  );
}

/** Sends, or asks once more in words that name what is lost. What else is discarded only the server knows: it is asked. */
async function send(model: Model, form: CommandForm, confirmed = false): Promise<void> {
  const ask = (words: string): void => {
    question.value = {
      title: `${form.title}?`,
      words: [words],
      caution: form.caution || "loses-settings",
      go: form.title,
      act: () => void send(model, form, true),
    };
  };
  const values = model.argumentsOf(form);
  const harms = form.caution !== "" && !Object.entries(form.harmless).some(([name, those]) => those.includes(Number(values[name])));
  if (!confirmed && harms && unfinishedOf(model).length === 0) return ask(form.consequence || "This cannot be undone.");
  const outcome = await server.run(model.id, form.name, values, confirmed);
  if (!confirmed && !outcome.ok && outcome.problem.kind === "confirm") return ask(outcome.problem.message);
  const job = await model.run(Promise.resolve(outcome));
  if (job === undefined) return;
  model.sent.value = { ...model.sent.value, [form.name]: job.id };
  if (form.writes === "") return;
  const { [form.name]: _, ...others } = model.arguments.peek(); // shows what the device has from now on
  model.arguments.value = others;
}
