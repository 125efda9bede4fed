// As much of CUDA as a generated kernel needs to run on a CPU, one thread after another.
#include <cmath>
#include <cstdlib>
#include <cstring>

#define __device__
#define __global__
#define __launch_bounds__(...)
#define __activemask() 1
// An episode of another thread of the warp ends every other time.
static int votes = 0;
#define __any_sync(threads, condition) ((condition) || votes++ % 2)
using std::abs; using std::floor; using std::sqrt; using std::atan2;

struct Index { unsigned x; };
extern "C" { Index threadIdx{0}, blockIdx{0}, blockDim{1}, gridDim{1}; }

template <class T> T max(T a, T b) { return a > b ? a : b; }
template <class T> T min(T a, T b) { return a < b ? a : b; }
#define __expf std::exp
#define __logf std::log
static int __float_as_int(float x) { int bits; std::memcpy(&bits, &x, 4); return bits; }
static float __int_as_float(int bits) { float x; std::memcpy(&x, &bits, 4); return x; }
