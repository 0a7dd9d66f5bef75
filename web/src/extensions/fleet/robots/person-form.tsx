/** Asks for the name of the person before something is done: it is logged with it. */
import { Button } from "../../../ui/controls/button";
import { storedName, storeName } from "../../../requests/person-name";
import { COMMON } from "../../../texts/common";
import { TEXT } from "./texts";
import "./settings.css";

interface Props {
  readonly title: string;
  readonly hint?: string;
  readonly send: (by: string) => Promise<void>;
  readonly cancel: () => void;
}

export function PersonForm({ title, hint = "", send, cancel }: Props) {
  const submit = (event: SubmitEvent): void => {
    event.preventDefault();
    const by = String(new FormData(event.currentTarget as HTMLFormElement).get("by") ?? "").trim();
    if (by === "") return;
    storeName(by);
    void send(by);
  };
  return (
    <form class="fleet-profile control-row" onSubmit={submit}>
      {hint !== "" && <p class="dim">{hint}</p>}
      <input
        name="by"
        type="text"
        maxLength={60}
        required
        autocomplete="name"
        aria-label={TEXT.yourName}
        placeholder={TEXT.yourName}
        title={TEXT.yourNameHint}
        defaultValue={storedName()}
        ref={(input) => input?.focus()}
      />
      <Button changes type="submit" look="edge" words={title} />
      <Button words={COMMON.cancel} onClick={cancel} />
    </form>
  );
}
