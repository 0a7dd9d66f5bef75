/** The page's pictograms: 16 px, strokes of 1.5 px, in the colour of the text beside them. */

const PATHS = {
  pause: "M5.5 3.5v9M10.5 3.5v9",
  play: "M5 3l8 5-8 5z",
  down: "M4 6l4 4 4-4",
  up: "M4 10l4-4 4 4",
  search: "M7 11.5a4.5 4.5 0 1 0 0-9 4.5 4.5 0 0 0 0 9zM10.500 10.500l3 3",
  right: "M3 8h9.500M9 4.500 12.500 8 9 11.500",
  left: "M13 8H3.500M7 4.500 3.500 8 7 11.500",
  undo: "M6 3.500 3 6.500l3 3M3.500 6.500h6a3.500 3.500 0 0 1 0 7H7",
  wand: "M3 13l7-7M11.500 2.500v2M11.500 6.500v2M8.500 5.500h1M13 5.500h1",
  wave: "M1.500 8.500h3l2-5 3 9 2-4h3",
  compare: "M1.500 6h2.500l2-3 3 6 2-3h3.500M1.500 11h2.500l2-3 3 6 2-3h3.500",
  sliders: "M2 5h6M11 5h3M9.500 3.500v3M2 11h2.500M7.500 11H14M6 9.500v3",
  library: "M2.500 3.500h11v9h-11zM2.500 6.500h11",
  flag: "M4 14V2.500h8l-2 3 2 3H4",
  loop: "M3 8V6.500a2 2 0 0 1 2-2h7M10 2.500l2 2-2 2M13 8v1.500a2 2 0 0 1-2 2H4M6 13.500l-2-2 2-2",
  upload: "M8 10.500v-8M4.500 6 8 2.500 11.500 6M3 13.500h10",
  download: "M8 2.500v8M4.500 7 8 10.500 11.500 7M3 13.500h10",
  share: "M8 9.500v-7M5 5l3-3 3 3M4.500 7.500H3v6h10v-6h-1.500",
  pin: "M8 10v4M5 2.500h6L10 7l2 3H4l2-3z",
  dots: "M3 8h.010M8 8h.010M13 8h.010",
  trash: "M3 4.500h10M6 4.500v-2h4v2M4.500 4.500l.6 9h5.800l.6-9",
  cube: "M8 1.800 13.500 5v6L8 14.200 2.500 11V5zM2.500 5 8 8.200 13.500 5M8 8.200v6",
  close: "M4 4l8 8M12 4l-8 8",
  paper: "M4 2.500h5.500l2.500 2.500v8.500H4zM6 7.500h4M6 10h4",
  plus: "M8 3v10M3 8h10",
  moon: "M13 9.5A5.5 5.5 0 0 1 6.5 3 5.5 5.5 0 1 0 13 9.5z",
  sun: "M8 10.7a2.7 2.7 0 1 0 0-5.4 2.7 2.7 0 0 0 0 5.4zM8 1.5v1.3M8 13.200v1.300M1.5 8h1.300M13.2 8h1.300M3.4 3.400l.9.9M11.7 11.700l.9.9M12.6 3.400l-.9.9M4.3 11.700l-.9.9",
  help: "M5.8 6a2.2 2.2 0 1 1 3.3 1.9c-.7.4-1.1.8-1.1 1.600M8 12.200v.1",
  side: "M2.5 3h11v10h-11zM10 3v10",
  list: "M5.5 4h8M5.5 8h8M5.5 12h8M2.5 4h.01M2.5 8h.01M2.5 12h.01",
  first: "M4 3.5v9M13 3.5 6.5 8l6.5 4.500z",
  last: "M12 3.5v9M3 3.5 9.5 8 3 12.500z",
  back: "M9.5 4 5.5 8l4 4",
  forward: "M6.5 4l4 4-4 4",
  stepBack: "M11 4.5 7.5 8l3.5 3.500M5 4.500v7",
  stepForward: "M5 4.5 8.5 8 5 11.500M11 4.500v7",
  minus: "M3 8h10",
  redo: "M10 3.500l3 3-3 3M12.500 6.500h-6a3.500 3.500 0 0 0 0 7H9",
  grid: "M2.5 3h11v10h-11zM2.5 7.500h7M9.5 3v10",
  grip: "M6 4h.010M10 4h.010M6 8h.010M10 8h.010M6 12h.010M10 12h.010",
  fit: "M2.5 6V2.500H6M10 2.500h3.500V6M13.5 10v3.500H10M6 13.500H2.500V10",
} as const;

export type IconName = keyof typeof PATHS;

export function Icon({ name }: { readonly name: IconName }) {
  return (
    <svg class="svg-icon" viewBox="0 0 16 16" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  );
}

export function Logo() {
  return (
    <svg viewBox="0 0 22 22" aria-hidden="true">
      <circle cx="11" cy="11" r="9.2" fill="none" stroke="currentColor" stroke-width="1.6" />
      <path d="M2.6 13.6 8 12.100M14 10.4 19.4 8.9" stroke="currentColor" stroke-width="1.6" stroke-linecap="round" />
      <circle cx="11" cy="11.25" r="1.7" fill="currentColor" />
    </svg>
  );
}
