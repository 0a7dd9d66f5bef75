/** A group: its settings one below the other, then its commands. */
import type { CommandForm } from "../../wire/form-types";
import type { Model } from "./model";
import { Setting } from "./setting-form";
import { CAUTIONS, linkTo, visibleSettings } from "./view-state";
import { COMMON } from "../../texts/common";
import { TEXT } from "../../texts/configure";

export function SettingGroup({ model, name }: { readonly model: Model; readonly name: string }) {
  const forms = model.forms.value;
  if (!forms) return null;
  const onlySends = forms.settings.length === 0;
  const settings = forms.settings.filter((form) => form.group === name);
  const commands = forms.commands.filter((form) => form.group === name);
  const visible = visibleSettings(model, name);
  // commands behind a setting's form are not listed again
  const others = commands.filter(
    (form) => model.page.all.value || settings.length === 0 || (form.kind === "do" && form.basic),
  );
  return (
    <>
      {visible.map((form) => (
        <Setting key={form.name} model={model} form={form} alone={visible.length === 1} />
      ))}
      {others.length > 0 && (
        <section class="setting" aria-label={TEXT.commands}>
          {settings.length > 0 && (
            <div class="setting-head">
              <h2>{TEXT.commands}</h2>
            </div>
          )}
          {onlySends && (
            <p class="hint inset" role="note">
              <b>{TEXT.noSettings(model.device.value?.name ?? COMMON.theDevice)}</b> {TEXT.framesToSend}
            </p>
          )}
          <ul class="commands">
            {others.map((form) => (
              <Row key={form.name} model={model} form={form} kind={onlySends ? TEXT.toTheDevice : KINDS[form.kind]} />
            ))}
          </ul>
        </section>
      )}
    </>
  );
}

const KINDS: Readonly<Record<CommandForm["kind"], string>> = { ask: TEXT.read, set: TEXT.write, do: TEXT.action };

interface RowProps {
  readonly model: Model;
  readonly form: CommandForm;
  readonly kind: string;
}

function Row({ model, form, kind }: RowProps) {
  return (
    <li>
      <a href={linkTo(model, form.name)}>
        <b>{form.title}</b>
        <span class="dim mono ellipsis">{form.name}</span>
        <span class="grow" />
        {form.caution ? <span class="tag">▲ {CAUTIONS[form.caution]}</span> : <span class="dim">{kind}</span>}
        {form.doc !== "" && <span class="field-help dim text-xs">{form.doc}</span>}
      </a>
    </li>
  );
}
