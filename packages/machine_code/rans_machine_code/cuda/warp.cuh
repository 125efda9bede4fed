// What the 32 threads of a warp do together in a kernel, on a GPU of capability 8.0 or later.

#ifdef __CUDA_ARCH__
__device__ inline int lane() { return threadIdx.x & 31; }

// Two numbers as bfloat16, rounded to nearest even: the first in the low bits.
__device__ inline unsigned packed(float low, float high) {
  unsigned both;
  asm("cvt.rn.bf16x2.f32 %0, %1, %2;" : "=r"(both) : "f"(high), "f"(low));
  return both;
}

// sums (16 x 8) += rows (16 x 16) * columns (16 x 8), spread over the warp as PTX's mma.m16n8k16 says.
__device__ inline void multiply(float (&sums)[4], const unsigned (&rows)[4], unsigned low, unsigned high) {
  asm("mma.sync.aligned.m16n8k16.row.col.f32.bf16.bf16.f32 {%0,%1,%2,%3}, {%4,%5,%6,%7}, {%8,%9}, {%0,%1,%2,%3};"
      : "+f"(sums[0]), "+f"(sums[1]), "+f"(sums[2]), "+f"(sums[3])
      : "r"(rows[0]), "r"(rows[1]), "r"(rows[2]), "r"(rows[3]), "r"(low), "r"(high));
}

// 16 x 16 numbers from rows in shared memory, spread as `multiply` takes them.
__device__ inline void gather(unsigned (&rows)[4], const unsigned short* from, int stride) {
  const int row = lane() & 15, column = lane() / 16 * 8;
  const unsigned at = unsigned(__cvta_generic_to_shared(from + row * stride + column));
  asm volatile("ldmatrix.sync.aligned.m8n8.x4.shared.b16 {%0,%1,%2,%3}, [%4];"
      : "=r"(rows[0]), "=r"(rows[1]), "=r"(rows[2]), "=r"(rows[3]) : "r"(at) : "memory");
}

__device__ inline float total(float x) {
  for (int other = 16; other; other /= 2) x += __shfl_xor_sync(~0u, x, other);
  return x;
}

// Within 2^-11 (PTX).
__device__ inline float quick_tanh(float x) {
  float y;
  asm("tanh.approx.f32 %0, %1;" : "=f"(y) : "f"(x));
  return y;
}
#endif
