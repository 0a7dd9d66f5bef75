/** The `?` overlay: every key, printed from the table that handles them. */
import { capabilities } from "../wire/capabilities";
import { Fragment } from "preact";
import { Button } from "../ui/controls/button";
import { Dialog } from "../ui/controls/dialog";
import { keyGroups, type KeyGroup } from "../page/keys";
import { serverRoot } from "../requests/server-place";
import { COMMON } from "../texts/common";
import { TEXT as GUIDE } from "../texts/guide";

interface Props {
  readonly onClose: () => void;
  readonly onGuide?: () => void;
  /** Keys of a page that has others than Live and the recordings. */
  readonly groups?: readonly KeyGroup[];
}

export function Help({ onClose, onGuide, groups }: Props) {
  const absent = new Map<string, string[]>();
  for (const { title, install } of capabilities.value.absent ?? [])
    absent.set(install, [...(absent.get(install) ?? []), title]);
  return (
    <Dialog title={COMMON.keyboard} onClose={onClose}>
      {onGuide && <Button look="edge open-guide" icon="paper" words={GUIDE.open} onClick={onGuide} />}
      <div class="key-groups">
        {(groups ?? keyGroups()).map(({ title, lines }) => (
          <section key={title}>
            <h3>{title}</h3>
            <dl class="keys">
              {lines.map((line) => (
                <Fragment key={line.what}>
                  <dt>
                    {line.keys.map((key) => (
                      <kbd key={key}>{key}</kbd>
                    ))}
                  </dt>
                  <dd>{line.what}</dd>
                </Fragment>
              ))}
            </dl>
          </section>
        ))}
      </div>
      {!groups && (
        <p class="hint" style={{ marginTop: "16px" }}>
          {COMMON.plotHelp}
        </p>
      )}
      <p class="hint">
        <a href={`${serverRoot()}/docs`} target="_blank" rel="noopener">
          {COMMON.apiReference}
        </a>
        {" · "}
        <a href={`${serverRoot()}/licenses.txt`} target="_blank" rel="noopener">
          {COMMON.licences}
        </a>
      </p>
      {absent.size > 0 && (
        <p class="hint">
          {COMMON.notInstalled}
          {[...absent].map(([install, titles]) => (
            <div key={install}>
              {titles.join(", ")}: <code>{install}</code>
            </div>
          ))}
        </p>
      )}
    </Dialog>
  );
}
