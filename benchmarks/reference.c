/* The arithmetic of the three-mass joint in plain C, to compare the kernel's speed with.

Every substep: the exact linear motion (a 6 x 6 matrix and inputs of its own for every joint), two
harmonics of cogging at the predicted middle angle, and smooth Coulomb friction of motor and gear
at the mean velocity, v + W d_c tanh(v / dq_0) = v_free, by Newton's method from the friction that
the last two substeps let expect, until a step is
enough or, without a change of sign, so short that the next would be. Joints
lie side by side in blocks of WIDTH, so that the compiler vectorises all loops over them; sine,
cosine and tanh are those of the vector library of glibc, where it has them.

Nothing is measured, delayed, rewarded or checked here.
*/

#include <math.h>

#ifndef WIDTH
#define WIDTH 8
#endif
#define TONES 2
#define LANES _Pragma("GCC ivdep") for (int l = 0; l < WIDTH; l++)

typedef struct {
    double x[6][WIDTH], a[6][6][WIDTH], motor[6][WIDTH], gear[6][WIDTH], load[6][WIDTH];
    double level[2][WIDTH], steep[WIDTH], enough[WIDTH], close[WIDTH], tone[TONES][3][WIDTH];
    double torque[WIDTH], pushed[WIDTH];
} block;

static void move(block *s, double h, int first, double drag[2][WIDTH], double old[2][WIDTH], double ripple[WIDTH])
{
    double free[6][WIDTH], wanted[2][WIDTH], v[2][WIDTH], w[2][2][WIDTH];
    for (int i = 0; i < 6; i++)
        LANES {
            double value = s->motor[i][l] * s->torque[l] + s->load[i][l] * s->pushed[l];
            for (int j = 0; j < 6; j++)
                value += s->a[i][j][l] * s->x[j][l];
            free[i][l] = value;
        }
    for (int pass = first ? 0 : 1; pass < 2; pass++)
        LANES {
            double q = free[0][l] + s->motor[0][l] * (ripple[l] - drag[0][l]) - s->gear[0][l] * drag[1][l];
            double dq = free[3][l] + s->motor[3][l] * (ripple[l] - drag[0][l]) - s->gear[3][l] * drag[1][l];
            double middle = 0.5 * (s->x[0][l] + q) + 0.125 * h * (s->x[3][l] - dq), total = 0.0;
            for (int j = 0; j < TONES; j++) {
                double angle = s->tone[j][0][l] * middle;
                /* gcc would join sin and cos of the same angle into a call that is no vector's. */
                total += s->tone[j][1][l] * sin(angle + M_PI_2) + s->tone[j][2][l] * sin(angle);
            }
            ripple[l] = total;
        }
    for (int k = 0; k < 2; k++)
        LANES {
            double last = drag[k][l];
            drag[k][l] = 2.0 * last - (first ? last : old[k][l]);
            old[k][l] = last;
        }
    LANES {
        for (int i = 0; i < 6; i++)
            free[i][l] += s->motor[i][l] * ripple[l];
        for (int k = 0; k < 2; k++) {
            w[k][0][l] = s->motor[k][l] / h;
            w[k][1][l] = s->gear[k][l] / h;
            wanted[k][l] = (free[k][l] - s->x[k][l]) / h;
            v[k][l] = wanted[k][l] - w[k][0][l] * drag[0][l] - w[k][1][l] * drag[1][l];
        }
    }
    for (int pass = 0; pass < 20; pass++) {
        int unsolved = 0;
        LANES {
            double t0 = tanh(v[0][l] * s->steep[l]), t1 = tanh(v[1][l] * s->steep[l]);
            double r0 = s->level[0][l] * t0, r1 = s->level[1][l] * t1;
            double g0 = s->level[0][l] * (1.0 - t0 * t0) * s->steep[l];
            double g1 = s->level[1][l] * (1.0 - t1 * t1) * s->steep[l];
            double e0 = v[0][l] - wanted[0][l] + w[0][0][l] * r0 + w[0][1][l] * r1;
            double e1 = v[1][l] - wanted[1][l] + w[1][0][l] * r0 + w[1][1][l] * r1;
            double j00 = 1.0 + w[0][0][l] * g0, j01 = w[0][1][l] * g1;
            double j10 = w[1][0][l] * g0, j11 = 1.0 + w[1][1][l] * g1;
            double scale = 1.0 / (j00 * j11 - j01 * j10);
            double d0 = (j11 * e0 - j01 * e1) * scale, d1 = (j00 * e1 - j10 * e0) * scale;
            double step0 = fabs(d0) - 1e-9 * fabs(v[0][l]), step1 = fabs(d1) - 1e-9 * fabs(v[1][l]);
            int same0 = v[0][l] * (v[0][l] - d0) > 0.0, same1 = v[1][l] * (v[1][l] - d1) > 0.0;
            unsolved += step0 > (same0 ? s->close[l] : s->enough[l]);
            unsolved += step1 > (same1 ? s->close[l] : s->enough[l]);
            v[0][l] -= d0;
            v[1][l] -= d1;
            drag[0][l] = r0 - g0 * d0;
            drag[1][l] = r1 - g1 * d1;
        }
        if (unsolved == 0)
            break;
    }
    LANES for (int i = 0; i < 6; i++)
        s->x[i][l] = free[i][l] - s->motor[i][l] * drag[0][l] - s->gear[i][l] * drag[1][l];
}

/* Advance all blocks by a control step. */
void advance(block *blocks, int count, int substeps, double h)
{
    for (int b = 0; b < count; b++) {
        block *s = blocks + b;
        double drag[2][WIDTH], old[2][WIDTH], ripple[WIDTH];
        LANES ripple[l] = 0.0;
        LANES drag[0][l] = s->level[0][l] * tanh(s->x[3][l] * s->steep[l]);
        LANES drag[1][l] = s->level[1][l] * tanh(s->x[4][l] * s->steep[l]);
        for (int step = 0; step < substeps; step++)
            move(s, h, step == 0, drag, old, ripple);
    }
}
