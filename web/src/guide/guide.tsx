/** The user guide within the page: its pages in a list, a search, and the page that is read. Fetched when it is first opened. */
import { useSignal } from "@preact/signals";
import { useEffect, useMemo, useRef } from "preact/hooks";
import { Dialog } from "../ui/controls/dialog";
import { SearchField } from "../ui/controls/search-field";
import { TEXT } from "../texts/guide";
import { markdown } from "./markdown";
import { type GuidePlace, PAGES, pageOf, searchGuide } from "./pages";
import "./guide.css";

interface Props {
  readonly onClose: () => void;
}

export function Guide({ onClose }: Props) {
  const query = useSignal("");
  const place = useSignal<GuidePlace>({ page: "first-look", heading: "", slug: "" });
  const text = useRef<HTMLElement>(null);
  const page = pageOf(place.value.page);
  const words = useMemo(
    () =>
      markdown(page?.text ?? "", {
        link(href, inside) {
          const [, name, slug = ""] = /^(?:([a-z-]+)\.md)?(?:#(.+))?$/.exec(href) ?? [];
          const target = name ?? place.peek().page;
          if (/^https?:/.test(href))
            return (
              <a href={href} target="_blank" rel="noopener">
                {inside}
              </a>
            );
          if (!pageOf(target) || (name === undefined && slug === "")) return <span>{inside}</span>; // of the repository
          return (
            <button type="button" class="link" onClick={() => (place.value = { page: target, heading: "", slug })}>
              {inside}
            </button>
          );
        },
      }),
    [page],
  );
  useEffect(() => {
    const heading = place.value.slug && text.current?.querySelector(`#guide-${CSS.escape(place.value.slug)}`);
    if (heading) heading.scrollIntoView();
    else text.current?.scrollTo(0, 0);
  }, [place.value]);
  const matches = (): readonly GuidePlace[] =>
    query.value.trim() ? searchGuide(query.value) : PAGES.map(({ name }) => ({ page: name, heading: "", slug: "" }));
  const found = matches();
  return (
    <Dialog title={TEXT.guide} onClose={onClose} wide>
      <div class="guide">
        <div class="guide-list">
          <SearchField
            label={TEXT.search}
            placeholder={TEXT.search}
            value={query.value}
            onText={(typed) => (query.value = typed)}
            onKeyDown={(event) => {
              const [first] = matches(); // the list is drawn a moment later
              if (event.key === "Enter" && first) place.value = first;
            }}
          />
          <nav class="categories" aria-label={TEXT.pages}>
            {found.map((one) => (
              <button
                type="button"
                key={`${one.page} ${one.slug}`}
                aria-pressed={one.page === place.value.page && one.slug === place.value.slug}
                onClick={() => (place.value = one)}
              >
                <span class="ellipsis">
                  {one.heading || pageOf(one.page)?.title}
                  {one.heading && <small class="dim ellipsis">{pageOf(one.page)?.title}</small>}
                </span>
              </button>
            ))}
            {found.length === 0 && <p class="dim">{TEXT.noMatch}</p>}
          </nav>
        </div>
        <article ref={text} tabIndex={0} aria-label={page?.title}>
          {words}
        </article>
      </div>
    </Dialog>
  );
}
