// Drawings of the page: lines on a field of 20 x 20.

const PATHS = {
  select: 'M5 3l11 6-5 1.5L8.5 16z',
  plan: 'M4 16a1.5 1.5 0 1 0 0-.01M16 4a1.5 1.5 0 1 0 0-.01M5.5 15.5C11 15 4 9 9 8s7 1 6.5-2.5',
  forbid: 'M10 3a7 7 0 1 0 .01 0M5.2 5.2l9.6 9.6',
  add: 'M10 3.5a6.5 6.5 0 1 0 .01 0M10 7v6M7 10h6',
  move: 'M10 2.5v15M2.5 10h15M10 2.5 8 4.5m2-2 2 2M10 17.5l-2-2m2 2 2-2M2.5 10l2-2m-2 2 2 2M17.5 10l-2-2m2 2-2 2',
  remove: 'M10 3.5a6.5 6.5 0 1 0 .01 0M7 10h6',
  force: 'M4.5 13.5a2 2 0 1 0 .01 0M15.5 2.5a2 2 0 1 0 .01 0M6 14 13.8 6.2M13.5 10V6.5H10',
  spawn: 'M8 3.5a2.5 2.5 0 1 0 .01 0M3 17c0-4 2-6 5-6 1.6 0 2.9.6 3.7 1.6M15 12v6M12 15h6',
  player: 'M10 3a2.5 2.5 0 1 0 .01 0M4.5 17c0-4 2.2-6 5.5-6s5.5 2 5.5 6z',
  chase: 'M2.5 10h8M7.5 6.5 11 10l-3.5 3.5M15.5 7.5a2.5 2.5 0 1 0 .01 0',
  send: 'M5 17V3.5M5 4h9l-2 3 2 3H5',
  teleport: 'M10 2.5v3M10 14.5v3M2.5 10h3M14.5 10h3M10 6.5a3.5 3.5 0 1 0 .01 0',
  top: 'M3 6l7-3 7 3-7 3zM3 6v8l7 3 7-3V6M10 9v8',
  frame: 'M3 7V3h4M13 3h4v4M17 13v4h-4M7 17H3v-4',
  graph:
    'M5 13.5a2 2 0 1 0 .01 0M14.5 12a2 2 0 1 0 .01 0M9.5 3a2 2 0 1 0 .01 0M6 13.7 8.7 7M10.5 6.8l3.2 5.4M7.2 15.3l5.2-.9',
  trails: 'M3 15c3-6 5 2 8-3s3-7 6-7M15 3l2 2-2 2',
  section: 'M3 10h14M5 10V5h10v5M5 13v2M15 13v2M8 16h4',
  follow: 'M2.5 10S5.5 5 10 5s7.5 5 7.5 5-3 5-7.5 5-7.5-5-7.5-5zM10 7.8a2.2 2.2 0 1 0 .01 0',
  undo: 'M7 4 3.5 7.5 7 11M4 7.5h7.5a4.5 4.5 0 0 1 0 9H7',
  redo: 'M13 4l3.5 3.5L13 11M16 7.5H8.5a4.5 4.5 0 0 0 0 9H13',
  close: 'M5 5l10 10M15 5 5 15',
  panel: 'M3 4h14v12H3zM12.5 4v12',
  help: 'M7.5 7.5c0-3.5 5-3.3 5 0 0 2.2-2.5 2.2-2.5 4.5M10 15v.5',
  sun: 'M10 6.5a3.5 3.5 0 1 0 .01 0M10 2v2M10 16v2M2 10h2M16 10h2M4.3 4.3l1.4 1.4M14.3 14.3l1.4 1.4M4.3 15.7l1.4-1.4M14.3 5.7l1.4-1.4',
  moon: 'M16 12.2A6.8 6.8 0 0 1 7.8 4a6.8 6.8 0 1 0 8.2 8.2z',
  system: 'M3 4h14v9H3zM7 16.5h6M10 13v3.5',
  trash: 'M4 6h12M8 6V3.5h4V6M5.5 6l.7 10.5h7.6L14.5 6M8.5 9v4.5M11.5 9v4.5',
  look: 'M9 3.5a5.5 5.5 0 1 0 .01 0M13 13l4 4',
  warn: 'M10 3 2.5 16.5h15zM10 8v4M10 14.2v.3',
  play: 'M6 4l10 6-10 6z',
  swap: 'M6 16V4M6 4 3 7m3-3 3 3M14 4v12m0 0-3-3m3 3 3-3',
  plus: 'M10 4v12M4 10h12',
  key: 'M6.5 8.5a3.5 3.5 0 1 0 .01 0M9.5 10.5 17 3M14 6l2.5 2.5',
  names: 'M3 4h8l6 6-6 6H3zM6.5 10h.01',
  next: 'M4 5l7 5-7 5zM15 5v10',
  replay: 'M4 10a6 6 0 1 0 2-4.5M4 3v3.5h3.5',
  pause: 'M7 4v12M13 4v12',
  stop: 'M5.5 5.5h9v9h-9z',
  record: 'M10 4a6 6 0 1 0 .01 0M10 8.4a1.6 1.6 0 1 0 .01 0',
  picture: 'M3 6h3.5L8 4h4l1.5 2H17v10H3zM10 8a3 3 0 1 0 .01 0',
  link: 'M8.5 11.5a3 3 0 0 0 4.2 0l3-3a3 3 0 0 0-4.2-4.2l-1 1M11.5 8.5a3 3 0 0 0-4.2 0l-3 3a3 3 0 0 0 4.2 4.2l1-1',
  check: 'M4 10.5 8 14.5 16 5.5',
} as const

export type IconName = keyof typeof PATHS

export function Icon({ name, size = 18 }: { name: IconName; size?: number }) {
  return (
    <svg class="icon" width={size} height={size} viewBox="0 0 20 20" aria-hidden="true">
      <path d={PATHS[name]} />
    </svg>
  )
}
