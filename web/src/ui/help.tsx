/** The `?` overlay: every key, printed from the table that handles them. */
import { Fragment } from "preact";
import { Dialog } from "./dialog";
import { KEY_GROUPS } from "./keys";
import { COMMON } from "../texts/common";

export function Help({ onClose }: { readonly onClose: () => void }) {
  return (
    <Dialog title={COMMON.keyboard} onClose={onClose}>
      <div class="key-groups">
        {KEY_GROUPS.map(({ title, lines }) => (
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
      <p class="hint" style={{ marginTop: "16px" }}>
        {COMMON.plotHelp}
      </p>
      <p class="hint">
        <a href="/docs" target="_blank" rel="noopener">
          {COMMON.apiReference}
        </a>
        {" · "}
        <a href="/licenses.txt" target="_blank" rel="noopener">
          {COMMON.licences}
        </a>
      </p>
    </Dialog>
  );
}
