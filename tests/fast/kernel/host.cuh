// As much of CUDA as a generated kernel needs to run on a CPU, one thread after another.
#include <cmath>
#include <cstdlib>
#include <cstring>

#define __device__
#define __global__
#define __launch_bounds__(threads)
using std::abs; using std::floor; using std::sqrt; using std::atan2;

struct uint1 { unsigned x; };
struct uint2 { unsigned x, y; };
struct uint4 { unsigned x, y, z, w; };
struct uchar1 { unsigned char x; };
struct uchar2 { unsigned char x, y; };
struct float1 { float x; };
struct float2 { float x, y; };
struct float4 { float x, y, z, w; };
struct double1 { double x; };
struct double2 { double x, y; };

struct Index { unsigned x; };
extern "C" { Index blockIdx{0}; }
static Index threadIdx{0}, blockDim{1};

template <class T> T max(T a, T b) { return a > b ? a : b; }
template <class T> T min(T a, T b) { return a < b ? a : b; }
#define __expf std::exp
static int __float_as_int(float x) { int bits; std::memcpy(&bits, &x, 4); return bits; }
