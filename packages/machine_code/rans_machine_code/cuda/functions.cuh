// Functions that the generated kernels call; `real` is float or double.

// Neighbours in memory, read or written at once.
template <class T, int N> struct alignas(sizeof(T) * N) Several { T of[N]; };

template <int N, class T> __device__ inline Several<T, N> read(const T* from, size_t group) {
  return reinterpret_cast<const Several<T, N>*>(from)[group];
}

template <int N, class T> __device__ inline void write(T* to, size_t group, const Several<T, N>& numbers) {
  reinterpret_cast<Several<T, N>*>(to)[group] = numbers;
}

// Brings memory into the second-level cache: whole pieces of 16 bytes, on chips that can.
template <class T> __device__ inline void fetch(const T* from, int count) {
#if defined(__CUDA_ARCH__) && __CUDA_ARCH__ >= 900
  const size_t start = reinterpret_cast<size_t>(from) / 16 * 16;
  asm volatile("cp.async.bulk.prefetch.L2.global [%0], %1;" ::"l"(start), "r"(int(count * sizeof(T))));
#endif
}

// An angle as quarter turns and a rest within pi/4. Cody and Waite's reduction: pi/2 as a sum of three
// floats; adding 1.5 * 2^23 rounds to a whole number and leaves it in the low bits. Good to 1e4 rad.
__device__ inline int quarters(float angle, float& rest) {
  const float shifted = fmaf(angle, 0.63661977f, 12582912.0f);
  const float turns = shifted - 12582912.0f;
  rest = fmaf(turns, -1.5707962513e+0f, angle);
  rest = fmaf(turns, -7.5497894159e-8f, rest);
  rest = fmaf(turns, -5.3903029534e-15f, rest);
  return __float_as_int(shifted);
}

// Sine and cosine within pi/4, below one unit in the last place: sinf and cosf of Cephes (Moshier, 1989).
__device__ inline float sine_of(int turns, float rest) {
  const float square = rest * rest;
  const float sine = fmaf(fmaf(fmaf(square, -1.9515295891e-4f, 8.3321608736e-3f), square, -1.6666654611e-1f),
                          square * rest, rest);
  const float cosine = fmaf(fmaf(fmaf(square, 2.443315711809948e-5f, -1.388731625493765e-3f), square,
                                 4.166664568298827e-2f), square * square, fmaf(square, -0.5f, 1.0f));
  const float size = turns & 1 ? cosine : sine;
  return turns & 2 ? -size : size;
}

// A third of the operations of CUDA's sinf and cosf; both of one angle share the reduction.
__device__ inline float sine(float angle) {
  float rest;
  const int turns = quarters(angle, rest);
  return sine_of(turns, rest);
}

__device__ inline float cosine(float angle) {
  float rest;
  const int turns = quarters(angle, rest);
  return sine_of(turns + 1, rest);
}

__device__ inline double sine(double angle) { return sin(angle); }
__device__ inline double cosine(double angle) { return cos(angle); }
__device__ inline float exponential(float x) { return __expf(x); }
__device__ inline double exponential(double x) { return exp(x); }
__device__ inline float logarithm(float x) { return __logf(x); }
__device__ inline double logarithm(double x) { return log(x); }
__device__ inline float logarithm_of_one_plus(float x) { return __logf(1.0f + x); }
__device__ inline double logarithm_of_one_plus(double x) { return log1p(x); }
