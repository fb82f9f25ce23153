/* The shift-invariant delay-and-sum of markerseek.signals written in C: how fast this machine can do it.
 *
 * Signals are samples first, channels contiguous, between silent columns. Row m of the tables belongs to the elements
 * m columns to the right and to the left; four distances are taken at a time; first is -1 where an element is not
 * used. The number of columns is a multiple of 32. Compiled when the benchmarks run, with -O3 -march=native.
 */
#include <string.h>

enum { PAD = 32, TILE = 16 };

static inline void add(float *restrict row, const float *const s[4], long wide, const float *u, const float *w,
                       int span)
{
    const float *restrict s0 = s[0], *restrict s1 = s[1], *restrict s2 = s[2], *restrict s3 = s[3];
    const float u0 = u[0], u1 = u[1], u2 = u[2], u3 = u[3], w0 = w[0], w1 = w[1], w2 = w[2], w3 = w[3];
    for (int block = 0; block < span; block += 32)
        for (int j = block; j < block + 32; j++)
            row[j] += (u0 * s0[j] + w0 * s0[j + wide] + u1 * s1[j] + w1 * s1[j + wide])
                    + (u2 * s2[j] + w2 * s2[j + wide] + u3 * s3[j] + w3 * s3[j + wide]);
}

void delay_and_sum(const float *signals, long wide, const int *first, const float *weight, const float *scale,
                   int distances, int depths, int columns, float *out)
{
    for (int start = 0; start < depths; start += TILE) {
        int stop = start + TILE < depths ? start + TILE : depths;
        memset(out + (long)start * columns, 0, sizeof(float) * (stop - start) * columns);
        for (int m = 0; m < distances; m += 4) {
            int span = (columns - m + 31) / 32 * 32;
            for (int z = start; z < stop; z++) {
                if (first[(long)m * depths + z] < 0)
                    continue;
                const float *right[4], *left[4];
                float u[4], w[4];
                for (int k = 0; k < 4; k++) {
                    int t = first[(long)(m + k) * depths + z];
                    w[k] = t < 0 ? 0 : weight[(long)(m + k) * depths + z];
                    u[k] = t < 0 ? 0 : 1 - w[k];
                    const float *row = signals + (t < 0 ? first[(long)m * depths + z] : t) * wide + PAD;
                    right[k] = row + m + k;
                    left[k] = row + columns - span - m - k;
                }
                float *row = out + (long)z * columns;
                add(row, right, wide, u, w, span);
                if (m == 0)
                    u[0] = w[0] = 0; /* the element straight above a column stands once in the sum */
                add(row + columns - span, left, wide, u, w, span);
            }
        }
        for (long i = (long)start * columns; i < (long)stop * columns; i++)
            out[i] *= scale[i];
    }
}
