import { defineConfig } from 'vitest/config'

export default defineConfig({
  test: {
    // Services start and graphs are built.
    testTimeout: 120_000,
    hookTimeout: 240_000,
    setupFiles: ['tests/setup.ts'],
    // Files share two cores with the services that they start.
    fileParallelism: false,
  },
})
