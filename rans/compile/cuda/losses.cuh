// PPO's losses of a sample, and their derivatives by the network's outputs. `choice`, `transition_losses` and `d_logit`
// are printed from `rans.compile.loss_gradient`.

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
  float opening[HEADS / 4], command[HEADS / 4];
#pragma unroll
  for (int i = 0; i < HEADS / 4; ++i) {
    const int column = i / 2 * 8 + first + i % 2;
    const bool is_thruster = column < THRUSTERS;
    command[i] = is_thruster && counts ? actions[i / 2 * 8 + i % 2] : 0.0f;
    float own_log_prob, own_entropy;
    choice(outputs[i], command[i], own_log_prob, own_entropy, opening[i]);
    log_prob += is_thruster ? own_log_prob : 0.0f;
    entropy += is_thruster ? own_entropy : 0.0f;
    value += column == THRUSTERS ? outputs[i] : 0.0f;
  }
  log_prob = of_four(log_prob), value = of_four(value), entropy = of_four(entropy);
  float d_log_prob, d_value, losses[STATISTICS];
  transition_losses(log_prob, entropy, value, sample.log_prob, sample.advantage, sample.target, given.clip_range,
                    given.vf_coef, d_log_prob, d_value, losses[0], losses[1], losses[2], losses[3], losses[4]);
#pragma unroll
  for (int i = 0; i < HEADS / 4; ++i) {
    const int column = i / 2 * 8 + first + i % 2;
    float own;
    d_logit(outputs[i], command[i], opening[i], d_log_prob, given.ent_coef, own);
    const float gradient = column < THRUSTERS ? own : d_value;
    outputs[i] = counts && column <= THRUSTERS ? gradient : 0.0f;
  }
  if (!counts || lane() % 4) return;
#pragma unroll
  for (int i = 0; i < STATISTICS; ++i) statistics[i] += losses[i];
}
