"""The flight kernel on a CPU: its very text, with a warp whose threads take turns in ``host_warp.cuh``."""

from __future__ import annotations

import subprocess
from ctypes import CDLL, c_int, c_void_p
from pathlib import Path
from typing import Any

import torch
from rans_machine_code.cuda.flight import FlightKernel

from rans.episode.step import World
from rans.policy.network import Network
from tests.support.host_kernels import COMPILER

_RUN = """
static void* pointers[7];
static int values[5];
static void thread() {
  flights((uint4*)pointers[0], (double*)pointers[1], (unsigned long long*)pointers[2],
          (unsigned long long*)pointers[3], (int*)pointers[4], (int*)pointers[5], (unsigned char*)pointers[6],
          values[0], values[1], values[2], values[3], values[4]);
  meet();  // until all are here
}
extern "C" void run(void** given, int* numbers) {
  std::memcpy(pointers, given, sizeof pointers);
  std::memcpy(values, numbers, sizeof values);
  for (int i = 31; i >= 0; --i) {
    getcontext(&threads[i]);
    threads[i].uc_stack.ss_sp = std::malloc(1 << 18);
    threads[i].uc_stack.ss_size = 1 << 18;
    threads[i].uc_link = &outside;
    makecontext(&threads[i], thread, 0);
    rounds[i] = 0;
  }
  running = 0;
  swapcontext(&outside, &threads[0]);
  for (auto& each : threads) std::free(each.uc_stack.ss_sp);
}
"""


class HostFlights(FlightKernel):
    """A flight kernel made by a C++ compiler, in blocks of one warp."""

    def __init__(self, world: World, network: Network, folder: Path, **how: Any) -> None:
        super().__init__(world, network, torch.device("cpu"), 2**20, most_warps=1, **how)
        file = folder / "flights.cpp"
        here = Path(__file__)
        headers = "".join(
            f'#include "{here.with_name(name)}"\n' for name in ("host.cuh", "host_warp.cuh")
        )
        file.write_text(headers + self.source + _RUN)
        made = file.with_suffix(".so")
        options = ("-std=c++17", "-O0", "-w", "-shared", "-fPIC")
        subprocess.run([COMPILER, *options, "-o", made, file], check=True)
        self._library = CDLL(str(made))

    def _launch(self, pointers: list[int], numbers: tuple[int, ...]) -> None:
        self._library.run((c_void_p * 7)(*pointers), (c_int * 5)(*numbers))
