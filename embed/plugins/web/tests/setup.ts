// One thread is enough for small networks, and leaves no workers behind.

import * as ort from 'onnxruntime-web/wasm'

ort.env.wasm.numThreads = 1
