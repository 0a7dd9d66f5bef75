/** Standing notices about the link: a slow USB latency timer and its fix, the clients, two protocols in one stream. */
import { Message } from "../ui/controls/message";
import { selected } from "./panel-context";
import type { Deps } from "../page/context";

export function Notices({ deps }: { readonly deps: Deps }) {
  return (
    <>
      {selected(deps)?.notices.map((notice) => (
        <p class="note notice" key={notice}>
          <span class="dot off" />
          <Message text={notice} />
        </p>
      ))}
    </>
  );
}
