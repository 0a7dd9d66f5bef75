/** "Fit to link": the server lowers rates until the line can carry them; the result is shown, and can be undone like any edit. */
import type { SettingForm } from "../../wire/form-types";
import type { Model } from "./model";
import { configureApi } from "./api";

export async function makeItFit(model: Model, form: SettingForm): Promise<void> {
  const answer = await model.run(configureApi.fit(model.id, form.name, model.valuesOf(form), model.baud.value ?? null));
  if (answer === undefined) return;
  for (const field of form.fields) {
    const value = answer.values[field.name];
    if (value !== undefined && !field.read_only) model.edit(form, [field.name], value);
  }
  model.fitting.value = { setting: form.name, words: answer.words, draft: model.drafts.peek()[form.name] };
}
