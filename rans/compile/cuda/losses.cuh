// PPO's losses of a sample, and their derivatives by the network's outputs: as `rans.fast.learn.ppo.losses`.

constexpr int STATISTICS = 5;

__device__ inline float of_four(float x) {
  x += __shfl_xor_sync(~0u, x, 1);
  return x + __shfl_xor_sync(~0u, x, 2);
}

__device__ inline float of_eight(float x) {
  for (int other = 4; other < 32; other *= 2) x += __shfl_xor_sync(~0u, x, other);
  return x;
}

struct Sample {
  float log_prob, advantage, target;  // log-probability at collection
};

struct Coefficients {
  float clip_range, vf_coef, ent_coef;
};

// Of one sample, a thread having two of every eight outputs: they become gradients of its losses. `actions` are
// at this thread's first column.
__device__ inline void learn(float (&outputs)[HEADS / 4], const float* actions, const Sample& sample,
                             const Coefficients& given, bool counts, float (&statistics)[STATISTICS]) {
  const int first = lane() % 4 * 2;
  float log_prob = 0.0f, entropy = 0.0f, value = 0.0f;
  float opening[HEADS / 4], chosen[HEADS / 4];
#pragma unroll
  for (int i = 0; i < HEADS / 4; ++i) {
    const int column = i / 2 * 8 + first + i % 2;
    const float logit = outputs[i];
    const bool is_thruster = column < THRUSTERS;
    chosen[i] = is_thruster && counts ? actions[i / 2 * 8 + i % 2] : 0.0f;
    // softplus(x) = max(x, 0) + log(1 + exp(-|x|)), and its slope
    const float small = __expf(-abs(logit)), bend = __logf(1.0f + small), whole = __fdividef(1.0f, 1.0f + small);
    opening[i] = logit >= 0.0f ? whole : small * whole;
    log_prob -= is_thruster ? max((1.0f - 2.0f * chosen[i]) * logit, 0.0f) + bend : 0.0f;
    entropy += is_thruster ? max(logit, 0.0f) + bend - logit * opening[i] : 0.0f;
    value += column == THRUSTERS ? logit : 0.0f;
  }
  log_prob = of_four(log_prob), value = of_four(value), entropy = of_four(entropy);
  // No gain where the ratio has left its range in the direction of the gain.
  const float change = log_prob - sample.log_prob, ratio = __expf(change), error = value - sample.target;
  const float gain = sample.advantage * ratio;
  const float clipped = sample.advantage * max(1.0f - given.clip_range, min(1.0f + given.clip_range, ratio));
  const float slope = gain <= clipped ? -gain : 0.0f;
#pragma unroll
  for (int i = 0; i < HEADS / 4; ++i) {
    const int column = i / 2 * 8 + first + i % 2;
    const float of_entropy = outputs[i] * opening[i] * (1.0f - opening[i]);
    const float of_logit = slope * (chosen[i] - opening[i]) + given.ent_coef * of_entropy;
    const float found = column < THRUSTERS ? of_logit : 2.0f * given.vf_coef * error;
    outputs[i] = counts && column <= THRUSTERS ? found : 0.0f;
  }
  if (!counts || lane() % 4) return;
  statistics[0] -= min(gain, clipped);
  statistics[1] += error * error;
  statistics[2] -= entropy;
  statistics[3] += ratio - 1.0f - change;
  statistics[4] += abs(ratio - 1.0f) > given.clip_range ? 1.0f : 0.0f;
}
