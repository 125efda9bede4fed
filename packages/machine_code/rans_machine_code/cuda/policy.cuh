// A policy's network for the 32 flights of a warp, one a thread, whose rows are spread over the threads.
//
// Numbers are sums of PARTS bfloat16 numbers, of which each holds what the ones before it leave. Of their
// products those count that are as large as the last part: one, three or six (Henry, Tang and Heinecke,
// "Leveraging the bfloat16 artificial intelligence datatype for higher-precision computations", 2019). Sums
// are of float32.

struct Tanh {
  static __device__ inline float of(float x) { return 1.0f - __fdividef(2.0f, __expf(2.0f * x) + 1.0f); }
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

template <int PARTS, class Function> __device__ inline float activated(float x) {
  return PARTS == 1 ? Function::quick(x) : Function::of(x);
}

// Two numbers, each in parts.
template <int PARTS> struct Pair {
  unsigned of[PARTS];
  __device__ inline Pair(float low, float high) {
#pragma unroll
    for (int part = 0; part < PARTS; ++part) {
      of[part] = packed(low, high);
      low -= __uint_as_float(of[part] << 16);
      high -= __uint_as_float(of[part] & 0xffff0000u);
    }
  }
};

// What the network is given, in shared memory: a row for each flight, the parts one after the other.
template <int PARTS> struct Inputs {
  unsigned short* from;
  int stride;

  // Writes some numbers of this thread's row, from a column on.
  template <int N> __device__ inline void show(int column, const float (&x)[N]) const {
    unsigned short* to = from + lane() * stride + column;
#pragma unroll
    for (int i = 0; i < N / 8 * 8; i += 8) {
      const Pair<PARTS> a(x[i], x[i + 1]), b(x[i + 2], x[i + 3]), c(x[i + 4], x[i + 5]), d(x[i + 6], x[i + 7]);
#pragma unroll
      for (int part = 0; part < PARTS; ++part)
        put(to + part * 32 * stride + i, {a.of[part], b.of[part], c.of[part], d.of[part]});
    }
#pragma unroll
    for (int i = N / 8 * 8; i < N; ++i) {
      const Pair<PARTS> one(x[i], 0.0f);
#pragma unroll
      for (int part = 0; part < PARTS; ++part) to[part * 32 * stride + i] = (unsigned short)one.of[part];
    }
  }

  __device__ static inline void put(unsigned short* to, const uint4& eight) {
    if (reinterpret_cast<size_t>(to) % 16 == 0) {
      *reinterpret_cast<uint4*>(to) = eight;
      return;
    }
    const unsigned pairs[] = {eight.x, eight.y, eight.z, eight.w};
#pragma unroll
    for (int i = 0; i < 8; ++i) to[i] = (unsigned short)(pairs[i / 2] >> i % 2 * 16);
  }

  __device__ inline void get(unsigned (&rows)[PARTS][4], int tile, int k) const {
#pragma unroll
    for (int part = 0; part < PARTS; ++part)
      gather(rows[part], from + (part * 32 + tile * 16) * stride + k * 16, stride);
  }
};

// Activations in registers: so many tiles of 16 flights, WIDTH numbers each.
template <int PARTS, int TILES, int WIDTH> struct Rows {
  unsigned of[PARTS][TILES][WIDTH / 16][4];

  __device__ inline void get(unsigned (&rows)[PARTS][4], int tile, int k) const {
#pragma unroll
    for (int i = 0; i < PARTS * 4; ++i) rows[i / 4][i % 4] = of[i / 4][tile][k][i % 4];
  }

  __device__ inline void set(const unsigned (&rows)[PARTS][4], int tile, int k) {
#pragma unroll
    for (int i = 0; i < PARTS * 4; ++i) of[i / 4][tile][k][i % 4] = rows[i / 4][i % 4];
  }
};

// 16 units of a layer with OUT of them, before their activation. Weights are in the order in which threads
// want them, one part after the other.
template <int PARTS, int TILES, int IN, int OUT, class X>
__device__ inline void units(const X& x, int pair, const uint4* weights, const float* bias,
                             float (&sums)[TILES][2][4]) {
#pragma unroll
  for (int half = 0; half < 2; ++half) {
    const float* own = bias + pair * 16 + half * 8 + lane() % 4 * 2;
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) {
      sums[tile][half][0] = sums[tile][half][2] = own[0];
      sums[tile][half][1] = sums[tile][half][3] = own[1];
    }
  }
#pragma unroll
  for (int k = 0; k < IN / 16; ++k) {
    uint4 both[PARTS];
#pragma unroll
    for (int part = 0; part < PARTS; ++part)
      both[part] = weights[part * (IN * OUT / 8) + (pair * (IN / 16) + k) * 32 + lane()];
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) {
      unsigned rows[PARTS][4];
      x.get(rows, tile, k);
#pragma unroll
      for (int a = PARTS - 1; a >= 0; --a)
#pragma unroll
        for (int b = PARTS - 1 - a; b >= 0; --b) {
          multiply(sums[tile][0], rows[a], both[b].x, both[b].y);
          multiply(sums[tile][1], rows[a], both[b].z, both[b].w);
        }
    }
  }
}

// Sums of 16 units as rows of what comes next: the spread of two results is that of one operand.
template <int PARTS, class Activation>
__device__ inline void activate(const float (&sums)[2][4], unsigned (&rows)[PARTS][4]) {
#pragma unroll
  for (int i = 0; i < 4; ++i) {
    const float* two = &sums[i / 2][i % 2 * 2];
    const Pair<PARTS> pair(activated<PARTS, Activation>(two[0]), activated<PARTS, Activation>(two[1]));
#pragma unroll
    for (int part = 0; part < PARTS; ++part) rows[part][i] = pair.of[part];
  }
}

template <class Activation, int PARTS, int TILES, int IN, int OUT, class X>
__device__ inline void layer(const X& x, const uint4* weights, const float* bias, Rows<PARTS, TILES, OUT>& y) {
#pragma unroll
  for (int pair = 0; pair < OUT / 16; ++pair) {
    float sums[TILES][2][4];
    units<PARTS, TILES, IN, OUT>(x, pair, weights, bias, sums);
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) {
      unsigned rows[PARTS][4];
      activate<PARTS, Activation>(sums[tile], rows);
      y.set(rows, tile, pair);
    }
  }
}

// The last layer, whose units go into the HEADS * 8 outputs at once; outputs (32, stride) are written by row.
template <class Activation, int PARTS, int TILES, int IN, int OUT, int HEADS, class X>
__device__ inline void answer(const X& x, const uint4* weights, const float* bias, const uint2* head,
                              const float* constant, float* outputs, int stride) {
  float out[TILES][HEADS][4] = {};
#pragma unroll(IN * OUT * PARTS > 16384 ? 2 : OUT / 16)
  for (int pair = 0; pair < OUT / 16; ++pair) {
    float sums[TILES][2][4];
    units<PARTS, TILES, IN, OUT>(x, pair, weights, bias, sums);
    unsigned rows[TILES][PARTS][4];
#pragma unroll
    for (int tile = 0; tile < TILES; ++tile) activate<PARTS, Activation>(sums[tile], rows[tile]);
#pragma unroll
    for (int h = 0; h < HEADS; ++h)
#pragma unroll
      for (int b = PARTS - 1; b >= 0; --b) {
        const uint2 both = head[b * (OUT * HEADS * 2) + (pair * HEADS + h) * 32 + lane()];
#pragma unroll
        for (int tile = 0; tile < TILES; ++tile)
#pragma unroll
          for (int a = PARTS - 1 - b; a >= 0; --a) multiply(out[tile][h], rows[tile][a], both.x, both.y);
      }
  }
  const int column = lane() % 4 * 2;
#pragma unroll
  for (int tile = 0; tile < TILES; ++tile)
#pragma unroll
    for (int i = 0; i < HEADS * 4; ++i) {
      const int row = tile * 16 + lane() / 4 + i % 4 / 2 * 8, unit = i / 4 * 8 + column + i % 2;
      outputs[row * stride + unit] = out[tile][i / 4][i % 4] + constant[unit];
    }
}
