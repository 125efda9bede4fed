"""The update's kernel on a CPU: its very text, with a block whose threads take turns in ``host_warp.cuh``."""

from __future__ import annotations

import subprocess
from ctypes import CDLL, c_void_p
from pathlib import Path

from rans.compile.cuda.update_design import WARPS
from rans.fast.learn.fused_gradient import UpdateKernel
from rans.fast.learn.ppo import PPOLearner
from tests.support.host_kernels import COMPILER

_RUN = """
static void* pointers[11];
static int number;
static void thread() {
  gradient((uint4*)pointers[0], (float*)pointers[1], (unsigned*)pointers[2], (float*)pointers[3],
           (float*)pointers[4], (float*)pointers[5], (float*)pointers[6], (float*)pointers[7],
           (float*)pointers[8], (float*)pointers[9], (float*)pointers[10], number);
  __syncthreads();  // until all are here
}
extern "C" void run(void** given, int count, int blocks) {
  std::memcpy(pointers, given, sizeof pointers);
  number = count, gridDim.x = blocks;
  for (blockIdx.x = 0; blockIdx.x < blocks; ++blockIdx.x) {
    for (int i = BLOCK - 1; i >= 0; --i) {
      getcontext(&threads[i]);
      threads[i].uc_stack.ss_sp = std::malloc(1 << 16);
      threads[i].uc_stack.ss_size = 1 << 16;
      threads[i].uc_link = &outside;
      makecontext(&threads[i], thread, 0);
      rounds[i] = 0;
    }
    running = 0;
    swapcontext(&outside, &threads[0]);
    for (auto& each : threads) std::free(each.uc_stack.ss_sp);
  }
}
"""


class HostUpdate(UpdateKernel):
    """A learner's kernel made by a C++ compiler, in two blocks."""

    blocks = 2  # type: ignore[assignment]

    def __init__(self, learner: PPOLearner, folder: Path) -> None:
        super().__init__(learner.network, learner.adam, learner.coefficients, 2**20)
        file = folder / "update.cpp"
        here = Path(__file__)
        headers = "".join(
            f'#include "{here.with_name(name)}"\n' for name in ("host.cuh", "host_warp.cuh")
        )
        file.write_text(f"#define BLOCK {32 * WARPS}\n{headers}{self.design.source()}{_RUN}")
        made = file.with_suffix(".so")
        options = ("-std=c++17", "-O1", "-w", "-fno-strict-aliasing", "-shared", "-fPIC")
        subprocess.run([COMPILER, *options, "-o", made, file], check=True)
        self._library = CDLL(str(made))

    def _launch(self, pointers: list[int], count: int) -> None:
        self._library.run((c_void_p * 11)(*pointers), count, self.blocks)
