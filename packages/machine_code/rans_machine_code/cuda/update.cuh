// What an update does between its products of matrices, which take bfloat16. Text before this one defines
// THRUSTERS, HEADS, a multiple of 8, STATISTICS and the functions `transition` and `through`. Every thread has many
// rows and writes their sums, so that the order of sums is fixed.

// A number of bfloat16 by its bits, and the nearest one; ties to even.
__device__ inline float widened(unsigned short bits) { return __int_as_float(int(bits) << 16); }
__device__ inline unsigned short nearest(float x) {
  const unsigned bits = __float_as_int(x);
  return x != x ? 0x7fff : (bits + 0x7fffu + (bits >> 16 & 1)) >> 16;
}

constexpr int AT_ONCE = THRUSTERS % 4 ? THRUSTERS % 2 ? 1 : 2 : 4;

// Losses of on/off thrusters, summed, and their derivatives by the outputs of the network, whose weights were
// rounded to bfloat16 for the first half of the outputs and left a rest for the second.
extern "C" __global__ void __launch_bounds__(128) losses(
    const float* outputs, const float* bias, const float* action, const float* log_prob, const float* advantage,
    const float* target, unsigned short* derivatives, float* sums, const int count, const int threads) {
  const int thread = blockIdx.x * blockDim.x + threadIdx.x;
  if (thread >= threads) return;
  float found[HEADS + STATISTICS] = {}, sum[HEADS + STATISTICS] = {};
  for (size_t i = thread; i < count; i += threads) {
    float output[HEADS];
#pragma unroll
    for (int p = 0; p < HEADS / 4; ++p) {
      const auto rounded = read<4>(outputs, i * (HEADS / 2) + p), rest = read<4>(outputs, i * (HEADS / 2) + HEADS / 4 + p);
#pragma unroll
      for (int k = 0; k < 4; ++k) output[4 * p + k] = rounded.of[k] + rest.of[k] + bias[4 * p + k];
    }
    float command[THRUSTERS];
#pragma unroll
    for (int p = 0; p < THRUSTERS / AT_ONCE; ++p) {
      const auto part = read<AT_ONCE>(action, i * (THRUSTERS / AT_ONCE) + p);
#pragma unroll
      for (int k = 0; k < AT_ONCE; ++k) command[AT_ONCE * p + k] = part.of[k];
    }
    transition(output, command, log_prob[i], advantage[i], target[i], found);
#pragma unroll
    for (int p = 0; p < HEADS / 8; ++p) {
      Several<unsigned short, 8> part;
#pragma unroll
      for (int k = 0; k < 8; ++k) part.of[k] = nearest(found[8 * p + k]);
      write(derivatives, i * (HEADS / 8) + p, part);
    }
#pragma unroll
    for (int k = 0; k < HEADS + STATISTICS; ++k) sum[k] += found[k];
  }
#pragma unroll
  for (int k = 0; k < HEADS + STATISTICS; ++k) sums[size_t(k) * threads + thread] = sum[k];
}

// Derivatives before an activation from its values and the derivatives after it, in rows of so many groups of 8,
// and their sums over every rows-th row.
extern "C" __global__ void __launch_bounds__(128) backward(
    const unsigned short* values, const unsigned short* after, unsigned short* before, float* sums, const int count,
    const int groups, const int rows) {
  const int thread = blockIdx.x * blockDim.x + threadIdx.x;
  const int group = thread % groups, first = thread / groups;
  if (first >= rows) return;
  Several<float, 8> sum = {};
#pragma unroll 4
  for (size_t i = first; i < count; i += rows) {
    const auto value = read<8>(values, i * groups + group), given = read<8>(after, i * groups + group);
    Several<unsigned short, 8> result;
#pragma unroll
    for (int k = 0; k < 8; ++k) {
      result.of[k] = nearest(through(widened(value.of[k]), widened(given.of[k])));
      sum.of[k] += widened(result.of[k]);
    }
    write(before, i * groups + group, result);
  }
  write(sums, thread, sum);
}
