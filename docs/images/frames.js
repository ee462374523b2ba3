// What the recordings share: Chromium with Studio, a clock that stands still, and the animated picture.
'use strict'

const { execFileSync } = require('node:child_process')
const fs = require('node:fs')
const path = require('node:path')

const page = path.join(__dirname, '../../studio/page')
const { chromium } = require(require.resolve('playwright-core', { paths: [page] }))

const QUALITIES = [60, 50, 42, 35, 29, 24, 20, 16, 12]

function launch() {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? '/usr/bin/chromium',
    args: ['--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader'],
  })
}

/** Lets the script hold the page's clock, and draw frames one by one. Runs in the page before all else. */
function holdClock() {
  const now = performance.now.bind(performance)
  const request = window.requestAnimationFrame.bind(window)
  let held
  let waiting = []
  performance.now = () => held ?? now()
  window.requestAnimationFrame = (act) => {
    if (held === undefined) return request(() => (held === undefined ? act(now()) : waiting.push(act)))
    return waiting.push(act)
  }
  window.frameAt = (time) => {
    held = time
    const due = waiting
    waiting = []
    for (const act of due) act(time)
  }
  localStorage.setItem('surefoot.tour', 'seen')
}

/** Waits until Studio has a map and its graph. */
async function ready(studio) {
  await studio.waitForFunction(() => window.surefootStudio?.state.graphs.state.value.kind === 'ready', undefined, {
    timeout: 120_000,
  })
  await studio.waitForFunction(() => window.surefootStudio.state.level.state.value.kind === 'ready')
  await studio.waitForTimeout(3000)
}

/** Writes frames as a picture of at most so many bytes. */
function encode(files, out, framesPerSecond, mostBytes) {
  const delay = String(Math.round(1000 / framesPerSecond))
  for (const quality of QUALITIES) {
    execFileSync('img2webp', ['-loop', '0', '-lossy', '-q', String(quality), '-m', '4', '-d', delay, ...files, '-o', out], {
      stdio: ['ignore', 'ignore', 'inherit'],
    })
    const { size } = fs.statSync(out)
    console.log(`${out}: ${files.length} frames, quality ${quality}, ${(size / 1e6).toFixed(2)} MB`)
    if (size <= mostBytes) return
  }
  throw new Error(`${out} is larger than ${mostBytes} bytes at any quality`)
}

module.exports = { encode, holdClock, launch, ready }
