/** Requests for the server's answers on drafts, on the device's values and on commands: shortly after the last key, the newest counts. */
import type { PreviewResult } from "../../wire/form-types";
import type { Outcome } from "../../requests/http";
import { configureApi } from "./api";
import type { Model } from "./model";

const PREVIEW_AFTER_MS = 150;

/** Previews of a model, by key: "Setting", "=Setting", "!Command". */
export class Previews {
  #timers = new Map<string, ReturnType<typeof setTimeout>>();
  #asked = new Map<string, number>();

  constructor(private readonly model: Model) {}

  /** Request the server's answer on a draft, shortly after the last key. */
  request(key: string, afterMs = PREVIEW_AFTER_MS): void {
    clearTimeout(this.#timers.get(key));
    if (!this.#asked.has(key)) this.#asked.set(key, 0);
    this.#timers.set(
      key,
      setTimeout(() => void this.#ask(key), afterMs),
    );
  }

  /** Load the previews of these drafts. */
  async now(keys: readonly string[]): Promise<void> {
    for (const key of keys) clearTimeout(this.#timers.get(key));
    await Promise.all(keys.map((key) => this.#ask(key)));
  }

  /** Stop requesting previews that are no longer on screen. */
  forget(key: string): void {
    clearTimeout(this.#timers.get(key));
    if (!(key in this.model.drafts.peek())) this.#asked.delete(key);
  }

  async #ask(key: string): Promise<void> {
    const turn = (this.#asked.get(key) ?? 0) + 1;
    this.#asked.set(key, turn);
    const request = this.#requestOf(key);
    const answer = request === undefined ? undefined : await request;
    if (this.#asked.get(key) !== turn) return; // a newer one is running
    const { [key]: _, ...others } = this.model.previews.peek();
    if (answer === undefined) this.model.previews.value = others;
    else if (answer.ok) this.model.previews.value = { ...others, [key]: answer.value };
    else this.model.problem.value = answer.problem;
  }

  #requestOf(key: string): Promise<Outcome<PreviewResult>> | undefined {
    if (key.startsWith("!")) {
      const command = this.model.command(key.slice(1));
      return command && configureApi.previewCommand(this.model.id, command.name, this.model.argumentsOf(command));
    }
    const isPresent = key.startsWith("=");
    const form = this.model.setting(isPresent ? key.slice(1) : key);
    if (form === undefined || !form.writable) return undefined;
    if (!isPresent && !this.model.isKnown(form)) return undefined; // initial values are not the device's
    const values = isPresent
      ? this.model.present.peek()[form.name]
      : form.partial
        ? this.model.changes.peek()[form.name]
        : this.model.valuesOf(form);
    if (values === undefined) return undefined;
    const own = form.fields.filter(({ name, read_only }) => !read_only && values[name] !== undefined);
    return configureApi.previewSetting(
      this.model.id,
      form.name,
      Object.fromEntries(own.map(({ name }) => [name, values[name]])),
    );
  }

  /** Request all again that are on screen. */
  again(): void {
    for (const key of this.#asked.keys()) this.request(key);
  }
}
