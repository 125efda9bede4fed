// The gradient of PPO's losses over a minibatch, for an actor-critic with two hidden layers, in one kernel.
//
// A warp takes 16 samples of a tile through the network and back, activations in registers. What it found is
// then exchanged through shared memory, and each warp adds the tile's to its own part of the weights' gradients,
// which stay in registers until the end. Operands are bfloat16, sums float32. Matrices lie in shared memory by
// rows, each longer by PAD than it need be, so that eight of them meet all banks. The inputs' last column but
// zeros is one, and so takes the place of the first layer's bias.

constexpr int TILE = 16 * WARPS;
constexpr int DOWN = WARPS > 1 ? WARPS / 2 : 1, ACROSS = WARPS / DOWN;  // parts of the second layer's gradient
constexpr int ROWS = SECOND / DOWN, COLUMNS = FIRST / ACROSS;           // of each part
constexpr int FIRST_TURNS = (FIRST / 16 + WARPS - 1) / WARPS, SECOND_TURNS = (SECOND / 16 + WARPS - 1) / WARPS;
constexpr unsigned ONES = 0x3f803f80;  // two of bfloat16

// 16 x 16 numbers as `gather` spreads them, to rows in shared memory.
__device__ inline void scatter(const unsigned (&rows)[4], unsigned short* to, int stride) {
  unsigned short* own = to + lane() / 4 * stride + lane() % 4 * 2;
#pragma unroll
  for (int i = 0; i < 4; ++i) *reinterpret_cast<unsigned*>(own + i % 2 * 8 * stride + i / 2 * 8) = rows[i];
}

// sums (16 x 16) += x (16 x 16 K) * weights^T, weights by unit (16 x 16 K).
template <int K>
__device__ inline void ahead(const unsigned (&x)[K][4], const unsigned short* weights, int stride,
                             float (&sums)[2][4]) {
#pragma unroll
  for (int k = 0; k < K; ++k) {
    unsigned both[4];
    gather(both, weights + k * 16, stride);
    multiply(sums[0], x[k], both[0], both[2]);
    multiply(sums[1], x[k], both[1], both[3]);
  }
}

// sums (16 x 16) += x (16 x 16 K) * weights, weights by unit (16 K x 16).
template <int K>
__device__ inline void back(const unsigned (&x)[K][4], const unsigned short* weights, int stride,
                            float (&sums)[2][4]) {
#pragma unroll
  for (int k = 0; k < K; ++k) {
    unsigned both[4];
    gather_turned(both, weights + k * 16 * stride, stride);
    multiply(sums[0], x[k], both[0], both[1]);
    multiply(sums[1], x[k], both[2], both[3]);
  }
}

// Gradients (16 x 16) before an activation, from those after it and its values.
__device__ inline void through(const float (&sums)[2][4], const unsigned (&values)[4], unsigned (&result)[4]) {
#pragma unroll
  for (int i = 0; i < 4; ++i) {
    const float low = __uint_as_float(values[i] << 16), high = __uint_as_float(values[i] & 0xffff0000u);
    const float* two = &sums[i / 2][i % 2 * 2];
    result[i] = packed(two[0] * slope(low), two[1] * slope(high));
  }
}

// Gradients of weights (16 M x 16 N) += d^T x over so many rows; d and x lie in shared memory by sample.
template <int M, int N>
__device__ inline void outer(float (&sums)[M][2 * N][4], const unsigned short* d, int d_stride,
                             const unsigned short* x, int x_stride, float (*ones)[4]) {
#pragma unroll 2
  for (int k = 0; k < TILE; k += 16) {
    unsigned rows[M][4];
#pragma unroll
    for (int m = 0; m < M; ++m) {
      unsigned found[4];
      gather_turned(found, d + k * d_stride + m * 16, d_stride);
      rows[m][0] = found[0], rows[m][1] = found[2], rows[m][2] = found[1], rows[m][3] = found[3];
      if (ones) multiply(ones[m], rows[m], ONES, ONES);
    }
#pragma unroll
    for (int n = 0; n < N; ++n) {
      unsigned both[4];
      gather_turned(both, x + k * x_stride + n * 16, x_stride);
#pragma unroll
      for (int m = 0; m < M; ++m) {
        multiply(sums[m][2 * n], rows[m], both[0], both[1]);
        multiply(sums[m][2 * n + 1], rows[m], both[2], both[3]);
      }
    }
  }
}

// Such sums to memory, by row.
template <int M, int N>
__device__ inline void tell(const float (&sums)[M][2 * N][4], float* to, int stride) {
#pragma unroll
  for (int i = 0; i < M * N * 8; ++i) {
    const int m = i / (N * 8), n = i / 4 % (2 * N), part = i % 4;
    to[(m * 16 + lane() / 4 + part / 2 * 8) * stride + n * 8 + lane() % 4 * 2 + part % 2] = sums[m][n][part];
  }
}

extern "C" __global__ void __launch_bounds__(32 * WARPS, 1) gradient(
    const uint4* weights, const float* biases, const unsigned* inputs, const float* actions,
    const float* log_probs, const float* advantages, const float* targets, const float* clip_range,
    const float* vf_coef, const float* ent_coef, float* sums, const int count) {
  // Weights, biases, and what the warps exchange.
  extern __shared__ uint4 shared[];
  constexpr int MATRICES = FIRST * (INPUTS + PAD) + SECOND * (FIRST + PAD) + 2 * HEADS * (SECOND + PAD);
  for (int i = threadIdx.x; i < MATRICES / 8; i += 32 * WARPS) shared[i] = weights[i];
  unsigned short* const first = reinterpret_cast<unsigned short*>(shared);
  unsigned short* const second = first + FIRST * (INPUTS + PAD);
  unsigned short* const head = second + SECOND * (FIRST + PAD);
  unsigned short* const rest = head + HEADS * (SECOND + PAD);  // of the heads' weights, after rounding
  unsigned short* const shown = rest + HEADS * (SECOND + PAD);
  unsigned short* const one_at = shown + TILE * (INPUTS + PAD);
  unsigned short* const two_at = one_at + TILE * (FIRST + PAD);
  unsigned short* const d_one_at = two_at + TILE * (SECOND + PAD);
  unsigned short* const d_two_at = d_one_at + TILE * (FIRST + PAD);
  unsigned short* const d_out_at = d_two_at + TILE * (SECOND + PAD);
  float* const bias = reinterpret_cast<float*>(d_out_at + TILE * (HEADS + PAD));
  for (int i = threadIdx.x; i < SECOND + HEADS; i += 32 * WARPS) bias[i] = biases[i];
  __syncthreads();

  const int warp = threadIdx.x / 32, own = warp * 16;
  const int down = warp / ACROSS * ROWS, across = warp % ACROSS * COLUMNS;
  const Coefficients given = {*clip_range, *vf_coef, *ent_coef};
  float by_first[FIRST_TURNS][1][INPUTS / 8][4] = {}, by_second[ROWS / 16][COLUMNS / 8][4] = {};
  float by_head[SECOND_TURNS][1][HEADS / 8][4] = {}, by_bias[ROWS / 16][4] = {}, by_constant[HEADS / 4] = {};
  float statistics[STATISTICS] = {};

  for (int tile = blockIdx.x; tile < (count + TILE - 1) / TILE; tile += gridDim.x) {
    // Forward: this thread has parts of two samples, eight apart.
    const int sample = tile * TILE + own + lane() / 4;
    unsigned x[INPUTS / 16][4], one[FIRST / 16][4], two[SECOND / 16][4];
#pragma unroll
    for (int i = 0; i < INPUTS / 4; ++i) {
      const int at = sample + i % 2 * 8, column = i / 4 * 8 + i % 4 / 2 * 4 + lane() % 4;
      x[i / 4][i % 4] = at < count ? inputs[size_t(at) * (INPUTS / 2) + column] : 0;
    }
#pragma unroll
    for (int k = 0; k < INPUTS / 16; ++k) scatter(x[k], shown + own * (INPUTS + PAD) + k * 16, INPUTS + PAD);
#pragma unroll
    for (int pair = 0; pair < FIRST / 16; ++pair) {
      float z[2][4] = {};
      ahead(x, first + pair * 16 * (INPUTS + PAD), INPUTS + PAD, z);
      unsigned rows[1][4];
      activate<1, Activation>(z, rows);
#pragma unroll
      for (int i = 0; i < 4; ++i) one[pair][i] = rows[0][i];
      scatter(one[pair], one_at + own * (FIRST + PAD) + pair * 16, FIRST + PAD);
    }
#pragma unroll
    for (int pair = 0; pair < SECOND / 16; ++pair) {
      float z[2][4];
#pragma unroll
      for (int i = 0; i < 8; ++i) z[i / 4][i % 4] = bias[pair * 16 + i / 4 * 8 + lane() % 4 * 2 + i % 2];
      ahead(one, second + pair * 16 * (FIRST + PAD), FIRST + PAD, z);
      unsigned rows[1][4];
      activate<1, Activation>(z, rows);
#pragma unroll
      for (int i = 0; i < 4; ++i) two[pair][i] = rows[0][i];
      scatter(two[pair], two_at + own * (SECOND + PAD) + pair * 16, SECOND + PAD);
    }

    // Losses, whose gradients take the outputs' places.
    unsigned d_out[HEADS / 16][4];
    float out[HEADS / 16][2][4];
#pragma unroll
    for (int pair = 0; pair < HEADS / 16; ++pair) {
#pragma unroll
      for (int i = 0; i < 8; ++i)
        out[pair][i / 4][i % 4] = bias[SECOND + pair * 16 + i / 4 * 8 + lane() % 4 * 2 + i % 2];
      ahead(two, rest + pair * 16 * (SECOND + PAD), SECOND + PAD, out[pair]);
      ahead(two, head + pair * 16 * (SECOND + PAD), SECOND + PAD, out[pair]);
    }
#pragma unroll
    for (int half = 0; half < 2; ++half) {
      const int at = sample + half * 8, place = min(at, count - 1);
      float outputs[HEADS / 4];
#pragma unroll
      for (int i = 0; i < HEADS / 4; ++i) outputs[i] = out[i / 4][i / 2 % 2][half * 2 + i % 2];
      learn(outputs, actions + size_t(place) * THRUSTERS + lane() % 4 * 2,
            {log_probs[place], advantages[place], targets[place]}, given, at < count, statistics);
#pragma unroll
      for (int i = 0; i < HEADS / 4; ++i) {
        by_constant[i] += outputs[i];
        out[i / 4][i / 2 % 2][half * 2 + i % 2] = outputs[i];
      }
    }
#pragma unroll
    for (int i = 0; i < HEADS / 4; ++i) {
      const float* both = &out[i / 4][i % 4 / 2][i % 2 * 2];
      d_out[i / 4][i % 4] = packed(both[0], both[1]);
    }
#pragma unroll
    for (int k = 0; k < HEADS / 16; ++k) scatter(d_out[k], d_out_at + own * (HEADS + PAD) + k * 16, HEADS + PAD);

    // Backward.
#pragma unroll
    for (int pair = 0; pair < SECOND / 16; ++pair) {
      float d[2][4] = {};
      back(d_out, head + pair * 16, SECOND + PAD, d);
      unsigned rows[4];
      through(d, two[pair], rows);
#pragma unroll
      for (int i = 0; i < 4; ++i) two[pair][i] = rows[i];
      scatter(rows, d_two_at + own * (SECOND + PAD) + pair * 16, SECOND + PAD);
    }
#pragma unroll
    for (int pair = 0; pair < FIRST / 16; ++pair) {
      float d[2][4] = {};
      back(two, second + pair * 16, FIRST + PAD, d);
      unsigned rows[4];
      through(d, one[pair], rows);
      scatter(rows, d_one_at + own * (FIRST + PAD) + pair * 16, FIRST + PAD);
    }
    __syncthreads();

    // The tile's part of the gradients.
    outer<ROWS / 16, COLUMNS / 16>(by_second, d_two_at + down, SECOND + PAD, one_at + across, FIRST + PAD,
                                   across ? nullptr : by_bias);
#pragma unroll
    for (int turn = 0; turn < SECOND_TURNS; ++turn)
      if (turn * WARPS + warp < SECOND / 16)
        outer<1, HEADS / 16>(by_head[turn], two_at + (turn * WARPS + warp) * 16, SECOND + PAD, d_out_at,
                             HEADS + PAD, nullptr);
#pragma unroll
    for (int turn = 0; turn < FIRST_TURNS; ++turn)
      if (turn * WARPS + warp < FIRST / 16)
        outer<1, INPUTS / 16>(by_first[turn], d_one_at + (turn * WARPS + warp) * 16, FIRST + PAD, shown,
                              INPUTS + PAD, nullptr);
    __syncthreads();
  }

  // This block's sums, in the order of `rans.fast.learn.fused_gradient.UpdateDesign.sums`.
  float* to = sums + size_t(blockIdx.x) * SUMS;
  tell<ROWS / 16, COLUMNS / 16>(by_second, to + down * FIRST + across, FIRST);
  to += SECOND * FIRST;
#pragma unroll
  for (int turn = 0; turn < FIRST_TURNS; ++turn)
    if (turn * WARPS + warp < FIRST / 16)
      tell<1, INPUTS / 16>(by_first[turn], to + (turn * WARPS + warp) * 16 * INPUTS, INPUTS);
  to += FIRST * INPUTS;
#pragma unroll
  for (int turn = 0; turn < SECOND_TURNS; ++turn)
    if (turn * WARPS + warp < SECOND / 16)
      tell<1, HEADS / 16>(by_head[turn], to + (turn * WARPS + warp) * 16 * HEADS, HEADS);
  to += SECOND * HEADS;
  if (!across && lane() % 4 == 0)
#pragma unroll
    for (int i = 0; i < ROWS / 8; ++i) to[down + i / 2 * 16 + i % 2 * 8 + lane() / 4] = by_bias[i / 2][i % 2 * 2];
  to += SECOND;
  // Of all warps, through shared memory.
  float* const each = reinterpret_cast<float*>(one_at);
#pragma unroll
  for (int i = 0; i < HEADS / 4; ++i) {
    const float found = of_eight(by_constant[i]);
    if (lane() < 4) each[warp * (HEADS + STATISTICS) + i / 2 * 8 + lane() * 2 + i % 2] = found;
  }
#pragma unroll
  for (int i = 0; i < STATISTICS; ++i) {
    const float found = total(statistics[i]);
    if (lane() == 0) each[warp * (HEADS + STATISTICS) + HEADS + i] = found;
  }
  __syncthreads();
  if (threadIdx.x < HEADS + STATISTICS) {
    float found = 0.0f;
    for (int i = 0; i < WARPS; ++i) found += each[i * (HEADS + STATISTICS) + threadIdx.x];
    to[threadIdx.x] = found;
  }
}
