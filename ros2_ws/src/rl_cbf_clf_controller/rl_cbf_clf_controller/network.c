/* The actor's network, see network.py. Compiled without fused operations: the processor changes no bit. */

#include <math.h> /* says, too, whether this is glibc */

#if defined(__x86_64__) && defined(__GLIBC__)
#define FOR_EACH_PROCESSOR __attribute__((target_clones("avx512f", "avx2", "default"))) /* chosen as it is loaded */
#else
#define FOR_EACH_PROCESSOR
#endif

typedef long long integer;

/* y = bias + weights' x, weights (inputs, outputs): term after term in the order of x, but for those of zeros.
   Four at a time, so that y is read and written less often. */
FOR_EACH_PROCESSOR
void layer(const float *restrict weights, const double *restrict bias, const double *restrict x, integer inputs,
           integer outputs, integer *restrict used, double *restrict y)
{
    integer count = 0, k = 0, i, j;
    for (j = 0; j < inputs; j++) { /* without a branch, since nobody can guess which units are zero */
        used[count] = j;
        count += x[j] != 0;
    }
    for (i = 0; i < outputs; i++)
        y[i] = bias[i];
    for (; k + 4 <= count; k += 4) {
        const float *a = weights + used[k] * outputs, *b = weights + used[k + 1] * outputs;
        const float *c = weights + used[k + 2] * outputs, *d = weights + used[k + 3] * outputs;
        const double p = x[used[k]], q = x[used[k + 1]], r = x[used[k + 2]], s = x[used[k + 3]];
        for (i = 0; i < outputs; i++)
            y[i] = (((y[i] + a[i] * p) + b[i] * q) + c[i] * r) + d[i] * s;
    }
    for (; k < count; k++) {
        const float *a = weights + used[k] * outputs;
        const double p = x[used[k]];
        for (i = 0; i < outputs; i++)
            y[i] += a[i] * p;
    }
}

/* n rows x (n, sizes[0]) to n rows (n, sizes[3]) at the end of `memory`; layer by layer, so that the weights stay near.
   tanh is libm's. `memory`: as many numbers as the widest layer has inputs, then n rows of each layer's outputs. */
void forward(integer n, const integer *sizes, integer widest, const float *weights, const double *biases,
             const double *x, double *memory)
{
    integer *used = (integer *)memory, l, row, i;
    double *y = memory + widest;
    for (l = 0; l < 3; l++) {
        const integer inputs = sizes[l], outputs = sizes[l + 1];
        for (row = 0; row < n; row++)
            layer(weights, biases, x + row * inputs, inputs, outputs, used, y + row * outputs);
        for (i = 0; i < n * outputs; i++)
            y[i] = l == 2 ? tanh(y[i]) : y[i] < 0 ? 0 : y[i];
        weights += inputs * outputs;
        biases += outputs;
        x = y;
        y += n * outputs;
    }
}
