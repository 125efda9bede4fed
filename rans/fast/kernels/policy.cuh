// A policy's network for the 32 flights of a warp, one a thread; its rows are spread over the threads.

struct Tanh {
  static __device__ inline float of(float x) { return tanhf(x); }
  static __device__ inline float quick(float x) { return quick_tanh(x); }
};
struct Relu {
  static __device__ inline float of(float x) { return max(x, 0.0f); }
  static __device__ inline float quick(float x) { return of(x); }
};
struct Elu {
  static __device__ inline float of(float x) { return x > 0.0f ? x : expm1f(x); }
  static __device__ inline float quick(float x) { return x > 0.0f ? x : __expf(x) - 1.0f; }
};

// With zero mean and unit variance, clipped.
template <int N>
__device__ inline void normalise(const float (&seen)[N], const float* mean, const float* scale, float clip,
                                 float* x) {
#pragma unroll
  for (int i = 0; i < N; ++i) x[i] = max(-clip, min(clip, (seen[i] - mean[i]) * scale[i]));
}

// ---- bfloat16, with sums of float32, on tensor cores ----

// Writes some numbers of this thread's row of inputs, from a column on.
template <int N>
__device__ inline void show(unsigned short* inputs, int stride, int column, const float (&x)[N]) {
  unsigned short* to = inputs + lane() * stride + column;
  if (N % 8 == 0 && column % 8 == 0) {
#pragma unroll
    for (int i = 0; i < N / 8; ++i)
      reinterpret_cast<uint4*>(to)[i] = {packed(x[8 * i], x[8 * i + 1]), packed(x[8 * i + 2], x[8 * i + 3]),
                                         packed(x[8 * i + 4], x[8 * i + 5]), packed(x[8 * i + 6], x[8 * i + 7])};
  } else {
#pragma unroll
    for (int i = 0; i < N; ++i) to[i] = (unsigned short)packed(x[i], 0.0f);
  }
}

// Activations in registers: so many tiles of 16 flights, WIDTH numbers each.
template <int TILES, int WIDTH> struct Rows {
  unsigned of[TILES][WIDTH / 16][4];
  __device__ inline void get(unsigned (&rows)[4], int tile, int k) const {
#pragma unroll
    for (int i = 0; i < 4; ++i) rows[i] = of[tile][k][i];
  }
};

// Inputs in shared memory.
struct Inputs {
  const unsigned short* from;
  int stride;
  __device__ inline void get(unsigned (&rows)[4], int tile, int k) const {
    gather(rows, from + tile * 16 * stride + k * 16, stride);
  }
};

// 16 units of a layer, before their activation. Weights are in the order in which threads want them.
template <int TILES, int IN, class X>
__device__ inline void units(const X& x, const uint4* weights, const float* bias,
                             float (&sums)[TILES][2][4]) {
#pragma unroll
  for (int half = 0; half < 2; ++half) {
    const float* own = bias + half * 8 + lane() % 4 * 2;
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) {
      sums[tile][half][0] = sums[tile][half][2] = own[0];
      sums[tile][half][1] = sums[tile][half][3] = own[1];
    }
  }
#pragma unroll
  for (int k = 0; k < IN / 16; ++k) {
    const uint4 both = weights[k * 32 + lane()];
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) {
      unsigned rows[4];
      x.get(rows, tile, k);
      multiply(sums[tile][0], rows, both.x, both.y);
      multiply(sums[tile][1], rows, both.z, both.w);
    }
  }
}

// Sums of 16 units as rows of what comes next: the spread of two results is that of one operand.
template <class Activation>
__device__ inline void activate(const float (&sums)[2][4], unsigned (&rows)[4]) {
#pragma unroll
  for (int i = 0; i < 4; ++i)
    rows[i] = packed(Activation::quick(sums[i / 2][i % 2 * 2]), Activation::quick(sums[i / 2][i % 2 * 2 + 1]));
}

template <class Activation, int TILES, int IN, int OUT, class X>
__device__ inline void layer(const X& x, const uint4* weights, const float* bias, Rows<TILES, OUT>& y) {
#pragma unroll
  for (int p = 0; p < OUT / 16; ++p) {
    float sums[TILES][2][4];
    units<TILES, IN>(x, weights + p * (IN / 16) * 32, bias + p * 16, sums);
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) activate<Activation>(sums[tile], y.of[tile][p]);
  }
}

// The last layer, whose units go into the HEADS * 8 outputs at once; outputs (32, stride) are written by row.
template <class Activation, int TILES, int IN, int OUT, int HEADS, class X>
__device__ inline void answer(const X& x, const uint4* weights, const float* bias, const uint2* head,
                              const float* constant, float* outputs, int stride) {
  float out[TILES][HEADS][4] = {};
#pragma unroll(OUT > 128 ? 2 : OUT / 16)
  for (int p = 0; p < OUT / 16; ++p) {
    float sums[TILES][2][4];
    units<TILES, IN>(x, weights + p * (IN / 16) * 32, bias + p * 16, sums);
    unsigned rows[TILES][4];
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) activate<Activation>(sums[tile], rows[tile]);
#pragma unroll
    for (int h = 0; h < HEADS; ++h) {
      const uint2 both = head[(p * HEADS + h) * 32 + lane()];
#pragma unroll
      for (int tile = 0; tile < TILES; ++tile) multiply(out[tile][h], rows[tile], both.x, both.y);
    }
  }
  const int column = lane() % 4 * 2;
#pragma unroll
  for (int tile = 0; tile < TILES; ++tile) {
#pragma unroll
    for (int i = 0; i < HEADS * 4; ++i) {
      const int row = tile * 16 + lane() / 4 + i % 4 / 2 * 8, unit = i / 4 * 8 + column + i % 2;
      outputs[row * stride + unit] = out[tile][i / 4][i % 4] + constant[unit];
    }
  }
}

// ---- float32, one flight a thread; activations are (WIDTH, 32) ----

template <int N> __device__ inline void show(float* inputs, int column, const float (&x)[N]) {
#pragma unroll
  for (int i = 0; i < N; ++i) inputs[(column + i) * 32 + lane()] = x[i];
}

struct Same {
  static __device__ inline float of(float x) { return x; }
};

// Weights are (IN, OUT), and the same for all threads; OUT is a multiple of 8.
template <class Activation, int IN, int OUT>
__device__ inline void exact_layer(const float* x, const float* weights, const float* bias, float* y) {
  for (int o = 0; o < OUT; o += 8) {
    float sums[8];
#pragma unroll
    for (int j = 0; j < 8; ++j) sums[j] = bias[o + j];
#pragma unroll 4
    for (int k = 0; k < IN; ++k) {
      const float given = x[k * 32 + lane()];
      const float4* own = reinterpret_cast<const float4*>(weights + k * OUT + o);
      const float4 a = own[0], b = own[1];
      sums[0] = fmaf(given, a.x, sums[0]); sums[1] = fmaf(given, a.y, sums[1]);
      sums[2] = fmaf(given, a.z, sums[2]); sums[3] = fmaf(given, a.w, sums[3]);
      sums[4] = fmaf(given, b.x, sums[4]); sums[5] = fmaf(given, b.y, sums[5]);
      sums[6] = fmaf(given, b.z, sums[6]); sums[7] = fmaf(given, b.w, sums[7]);
    }
#pragma unroll
    for (int j = 0; j < 8; ++j) y[(o + j) * 32 + lane()] = Activation::of(sums[j]);
  }
}
