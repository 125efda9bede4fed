// The threads of a block on a CPU, by turns: each runs up to what they do together, then the next.
#include <cstdint>
#include <ucontext.h>

#undef __any_sync
#define __constant__
#define __shared__
#define __syncwarp meet
#ifndef BLOCK
#define BLOCK 32
#endif

struct uint2 { unsigned x, y; };
struct uint4 { unsigned x, y, z, w; };
struct float4 { float x, y, z, w; };
alignas(16) uint4 shared[1 << 16];

static ucontext_t outside, threads[BLOCK];
static int running;
#define threadIdx (Index{unsigned(running)})
static int rounds[BLOCK];
static unsigned char given[2][BLOCK][32];  // what threads tell one another, in this round and the one before

static int lane() { return running % 32; }
static void meet() {
  const int own = running;
  running = (own + 1) % BLOCK;
  swapcontext(&threads[own], &threads[running]);
  running = own;
}
static void __syncthreads() {
  static int arrived = 0, times = 0;
  const int before = times;
  if (++arrived == BLOCK) arrived = 0, ++times;
  while (times == before) meet();
}

// The values of a warp's threads; they last until the next but one exchange.
template <class T> static unsigned char (*tell(const T& value))[32] {
  auto* all = given[rounds[running]++ % 2] + running / 32 * 32;
  std::memcpy(all[lane()], &value, sizeof(T));
  meet();
  return all;
}
template <class T> static T told(unsigned char (*all)[32], int by) {
  T value;
  std::memcpy(&value, all[by], sizeof(T));
  return value;
}
static float __shfl_xor_sync(unsigned, float own, int other) { return told<float>(tell(own), lane() ^ other); }

static bool __any_sync(unsigned, bool own) {
  auto* all = tell(own);
  bool any = false;
  for (int i = 0; i < 32; ++i) any |= told<bool>(all, i);
  return any;
}
static float total(float own) {
  auto* all = tell(own);
  float sum = 0;
  for (int i = 0; i < 32; ++i) sum += told<float>(all, i);
  return sum;
}

// bfloat16, to nearest even.
static unsigned rounded(float x) {
  unsigned bits;
  std::memcpy(&bits, &x, 4);
  return (bits + 0x7fff + (bits >> 16 & 1)) >> 16;
}
static unsigned packed(float low, float high) { return rounded(low) | rounded(high) << 16; }
static float half(unsigned both, int upper) {
  const unsigned bits = upper ? both & 0xffff0000u : both << 16;
  float x;
  std::memcpy(&x, &bits, 4);
  return x;
}

// PTX ISA, "Matrix fragments for mma.m16n8k16 with floating point type".
struct Fragments { unsigned rows[4], low, high; };
static void multiply(float (&sums)[4], const unsigned (&rows)[4], unsigned low, unsigned high) {
  auto* all = tell(Fragments{{rows[0], rows[1], rows[2], rows[3]}, low, high});
  for (int i = 0; i < 4; ++i) {
    const int row = lane() / 4 + i / 2 * 8, column = lane() % 4 * 2 + i % 2;
    for (int k = 0; k < 16; ++k) {
      const auto left = told<Fragments>(all, row % 8 * 4 + k % 8 / 2);
      const auto right = told<Fragments>(all, column * 4 + k % 8 / 2);
      sums[i] += half(left.rows[row / 8 + k / 8 * 2], k % 2) * half(k < 8 ? right.low : right.high, k % 2);
    }
  }
}
static void gather(unsigned (&rows)[4], const unsigned short* from, int stride) {
  for (int i = 0; i < 4; ++i) {
    const auto* at = from + (lane() / 4 + i % 2 * 8) * stride + lane() % 4 * 2 + i / 2 * 8;
    rows[i] = at[0] | unsigned(at[1]) << 16;
  }
}
static float quick_tanh(float x) { return std::tanh(x); }
template <class T> static T atomicAdd(T* at, T more) { const T old = *at; *at += more; return old; }
template <class T> static T min(T a, double b) { return min(a, T(b)); }
static float __uint_as_float(unsigned bits) { return half(bits, 1); }  // of upper halves only
#define __fdividef(a, b) ((a) / (b))
