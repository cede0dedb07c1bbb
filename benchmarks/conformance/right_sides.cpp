#include "right_sides.hpp"

#include <algorithm>
#include <cmath>

namespace {

constexpr double pi = 3.14159265358979323846;

void robertson(int, bool, double, const double* y, double* f) {
    const double slow = 0.04 * y[0], fast = 3e7 * y[1] * y[1], turn = 1e4 * y[1] * y[2];
    f[0] = turn - slow;
    f[1] = slow - turn - fast;
    f[2] = fast;
}

void hires(int, bool, double, const double* y, double* f) {
    const double bind = 280 * y[5] * y[7];
    f[0] = -1.71 * y[0] + 0.43 * y[1] + 8.32 * y[2] + 0.0007;
    f[1] = 1.71 * y[0] - 8.75 * y[1];
    f[2] = -10.03 * y[2] + 0.43 * y[3] + 0.035 * y[4];
    f[3] = 8.32 * y[1] + 1.71 * y[2] - 1.12 * y[3];
    f[4] = -1.745 * y[4] + 0.43 * (y[5] + y[6]);
    f[5] = -bind + 0.69 * y[3] + 1.71 * y[4] - 0.43 * y[5] + 0.69 * y[6];
    f[6] = bind - 1.81 * y[6];
    f[7] = -f[6];
}

void oregonator(int, bool, double, const double* y, double* f) {
    f[0] = 77.27 * (y[1] + y[0] * (1 - 8.375e-6 * y[0] - y[1]));
    f[1] = (y[2] - (1 + y[0]) * y[1]) / 77.27;
    f[2] = 0.161 * (y[0] - y[2]);
}

template <int exponent>
void van_der_pol(int, bool, double, const double* y, double* f) {
    double square = 1; // of mu
    for (int i = 0; i < exponent; ++i) square *= 100;
    f[0] = y[1];
    f[1] = ((1 - y[0] * y[0]) * y[1] - y[0]) * square;
}

void e5(int, bool, double, const double* y, double* f) {
    constexpr double a = 7.89e-10, b = 1.1e7, c = 1.13e3, m = 1e6;
    const double third_species = y[1] - y[2];
    const double first = a * y[0], second = b * y[0] * third_species, third = m * c * y[1] * third_species;
    f[0] = -first - second;
    f[1] = first - third;
    f[2] = second - c * y[2];
}

void pollution(int, bool, double, const double* y, double* f) {
    const double r1 = 0.35 * y[0], r2 = 26.6 * y[1] * y[3], r3 = 12300 * y[4] * y[1], r4 = 0.00086 * y[6],
                 r5 = 0.00082 * y[6], r6 = 15000 * y[6] * y[5], r7 = 0.00013 * y[8], r8 = 24000 * y[8] * y[5],
                 r9 = 16500 * y[10] * y[1], r10 = 9000 * y[10] * y[0], r11 = 0.022 * y[12], r12 = 12000 * y[9] * y[1],
                 r13 = 1.88 * y[13], r14 = 16300 * y[0] * y[5], r15 = 4.8e6 * y[2], r16 = 0.00035 * y[3],
                 r17 = 0.0175 * y[3], r18 = 1e8 * y[15], r19 = 4.44e11 * y[15], r20 = 1240 * y[16] * y[5],
                 r21 = 2.1 * y[18], r22 = 5.78 * y[18], r23 = 0.0474 * y[0] * y[3], r24 = 1780 * y[18] * y[0],
                 r25 = 3.12 * y[19];
    f[0] = -r1 - r10 - r14 - r23 - r24 + r2 + r3 + r9 + r11 + r12 + r22 + r25;
    f[1] = -r2 - r3 - r9 - r12 + r1 + r21;
    f[2] = -r15 + r1 + r17 + r19 + r22;
    f[3] = -r2 - r16 - r17 - r23 + r15;
    f[4] = -r3 + 2 * r4 + r6 + r7 + r13 + r20;
    f[5] = -r6 - r8 - r14 - r20 + r3 + 2 * r18;
    f[6] = -r4 - r5 - r6 + r13;
    f[7] = r4 + r5 + r6 + r7;
    f[8] = -r7 - r8;
    f[9] = -r12 + r7 + r9;
    f[10] = -r9 - r10 + r8 + r11;
    f[11] = r9;
    f[12] = -r11 + r10;
    f[13] = -r13 + r12;
    f[14] = r14;
    f[15] = -r18 - r19 + r16;
    f[16] = -r20;
    f[17] = r20;
    f[18] = -r21 - r22 - r24 + r23 + r25;
    f[19] = -r25 + r24;
}

double diode(double u) { return 40.67286402e-9 * (std::exp(17.7493332 * u) - 1); }

void ring_modulator(int, bool, double t, const double* y, double* f) {
    constexpr double c = 1.6e-8, cs = 2e-12, cp = 1e-8, r = 25000, rp = 50, lh = 4.45, ls1 = 0.002, ls2 = 0.0005,
                     ls3 = 0.0005, rg1 = 36.3, rg2 = 17.3, rg3 = 17.3, ri = 50, rc = 600;
    const double low = 0.5 * std::sin(2000 * pi * t), high = 2 * std::sin(20000 * pi * t);
    const double q1 = diode(y[2] - y[4] - y[6] - high), q2 = diode(-y[3] + y[5] - y[6] - high),
                 q3 = diode(y[3] + y[4] + y[6] + high), q4 = diode(-y[2] - y[5] + y[6] + high);
    f[0] = (y[7] - 0.5 * y[9] + 0.5 * y[10] + y[13] - y[0] / r) / c;
    f[1] = (y[8] - 0.5 * y[11] + 0.5 * y[12] + y[14] - y[1] / r) / c;
    f[2] = (y[9] - q1 + q4) / cs;
    f[3] = (-y[10] + q2 - q3) / cs;
    f[4] = (y[11] + q1 - q3) / cs;
    f[5] = (-y[12] - q2 + q4) / cs;
    f[6] = (-y[6] / rp + q1 + q2 - q3 - q4) / cp;
    f[7] = -y[0] / lh;
    f[8] = -y[1] / lh;
    f[9] = (0.5 * y[0] - y[2] - rg2 * y[9]) / ls2;
    f[10] = (-0.5 * y[0] + y[3] - rg3 * y[10]) / ls3;
    f[11] = (0.5 * y[1] - y[4] - rg2 * y[11]) / ls2;
    f[12] = (-0.5 * y[1] + y[5] - rg3 * y[12]) / ls3;
    f[13] = (-y[0] + low - (ri + rg1) * y[13]) / ls1;
    f[14] = (-y[1] - (rc + rg1) * y[14]) / ls1;
}

void arenstorf(int, bool, double, const double* y, double* f) {
    constexpr double mu = 0.012277471, rest = 1 - mu;
    const double a = y[0] + mu, b = y[0] - rest;
    const double ra = a * a + y[1] * y[1], rb = b * b + y[1] * y[1];
    const double earth = rest / (ra * std::sqrt(ra)), moon = mu / (rb * std::sqrt(rb));
    f[0] = y[2];
    f[1] = y[3];
    f[2] = y[0] + 2 * y[3] - earth * a - moon * b;
    f[3] = y[1] - 2 * y[2] - earth * y[1] - moon * y[1];
}

void pleiades(int, bool, double, const double* y, double* f) {
    for (int i = 0; i < 14; ++i) f[i] = y[14 + i];
    for (int i = 14; i < 28; ++i) f[i] = 0;
    for (int i = 0; i < 7; ++i) {
        for (int j = 0; j < i; ++j) {
            const double dx = y[j] - y[i], dy = y[7 + j] - y[7 + i];
            const double square = dx * dx + dy * dy, pull = 1 / (square * std::sqrt(square));
            f[14 + i] += (j + 1) * pull * dx;
            f[21 + i] += (j + 1) * pull * dy;
            f[14 + j] -= (i + 1) * pull * dx;
            f[21 + j] -= (i + 1) * pull * dy;
        }
    }
}

void akzo(int states, bool late, double, const double* y, double* f) {
    const int n = states / 2;
    const double h = 1.0 / n, phi = late ? 0 : 2;
    for (int i = 0; i < n; ++i) {
        const double zeta = (i + 1) * h - 1, cube = zeta * zeta * zeta;
        const double alpha = cube / 8, beta = cube * zeta / 16;
        const double u = y[2 * i], reaction = 100 * u * y[2 * i + 1];
        const double before = i > 0 ? y[2 * i - 2] : phi, after = i + 1 < n ? y[2 * i + 2] : u;
        f[2 * i] = alpha * (after - before) / (2 * h) + beta * (before - 2 * u + after) / (h * h) - reaction;
        f[2 * i + 1] = -reaction;
    }
}

void brusselator(int states, bool, double, const double* y, double* f) {
    const int n = states / 2;
    const double spread = 0.02 * (n + 1) * (n + 1);
    for (int i = 0; i < n; ++i) {
        const double u = y[2 * i], v = y[2 * i + 1], turn = u * u * v;
        const double u0 = i > 0 ? y[2 * i - 2] : 1, v0 = i > 0 ? y[2 * i - 1] : 3;
        const double u1 = i + 1 < n ? y[2 * i + 2] : 1, v1 = i + 1 < n ? y[2 * i + 3] : 3;
        f[2 * i] = 1 + turn - 4 * u + spread * (u0 - 2 * u + u1);
        f[2 * i + 1] = 3 * u - turn + spread * (v0 - 2 * v + v1);
    }
}

std::vector<double> ones(int n, double value = 1) { return std::vector<double>(n, value); }

Problem akzo_of(int n) {
    Problem problem{"MEDAKZO n=400", 20, 5, 2, true, {}, ones(2 * n), akzo};
    for (int i = 0; i < n; ++i) problem.start.insert(problem.start.end(), {0, 1});
    return problem;
}

Problem brusselator_of(const char* name, int n) {
    Problem problem{name, 10, 0, 2, true, {}, ones(2 * n), brusselator};
    for (int i = 0; i < n; ++i) {
        const double x = (i + 1.0) / (n + 1);
        problem.start.insert(problem.start.end(), {1 + std::sin(2 * pi * x), 3});
    }
    return problem;
}

std::vector<double> ring_nominal() {
    auto scale = ones(15);
    std::fill(scale.begin() + 7, scale.end(), 1e-3);
    return scale;
}

} // namespace

const std::vector<Problem>& problems() {
    static const std::vector<Problem> all = {
        {"ROBER", 1e11, 0, 0, true, {1, 0, 0}, {1e-6, 1e-12, 1}, robertson},
        {"HIRES", 321.8122, 0, 0, true, {1, 0, 0, 0, 0, 0, 0, 0.0057}, ones(8, 1e-3), hires},
        {"OREGO", 360, 0, 0, true, {1, 2, 3}, ones(3), oregonator},
        {"VDPOL mu=1e3", 2, 0, 0, true, {2, 0}, ones(2), van_der_pol<3>},
        {"VDPOL mu=1e4", 2, 0, 0, true, {2, 0}, ones(2), van_der_pol<4>},
        {"VDPOL mu=1e5", 2, 0, 0, true, {2, 0}, ones(2), van_der_pol<5>},
        {"VDPOL mu=1e6", 2, 0, 0, true, {2, 0}, ones(2), van_der_pol<6>},
        {"E5", 1e13, 0, 0, true, {1.76e-3, 0, 0}, {1e-3, 1e-18, 1e-18}, e5},
        {"POLLU",
         60,
         0,
         0,
         true,
         {0, 0.2, 0, 0.04, 0, 0, 0.1, 0.3, 0.01, 0, 0, 0, 0, 0, 0, 0, 0.007, 0, 0, 0},
         ones(20, 1e-3),
         pollution},
        {"RINGMOD", 1e-3, 0, 0, true, ones(15, 0), ring_nominal(), ring_modulator},
        akzo_of(200),
        brusselator_of("BRUSSELATOR n=40", 20),
        brusselator_of("BRUSSELATOR n=400", 200),
        brusselator_of("BRUSSELATOR n=2000", 1000),
        {"ARENSTORF",
         17.0652165601579625588917206249,
         0,
         0,
         false,
         {0.994, 0, 0, -2.00158510637908252240537862224},
         ones(4),
         arenstorf},
        {"PLEIADES",
         3,
         0,
         0,
         false,
         {3, 3, -1, -3, 2, -2, 2, 3, -3, 2, 0, 0, -4, 4, 0, 0, 0, 0, 0, 1.75, -1.5, 0, 0, 0, -1.25, 1, 0, 0},
         ones(28),
         pleiades},
    };
    return all;
}

int problem_count() { return static_cast<int>(problems().size()); }
const char* problem_name(int k) { return problems()[k].name; }
int problem_size(int k) { return static_cast<int>(problems()[k].start.size()); }
double problem_end(int k) { return problems()[k].end; }
double problem_jump(int k) { return problems()[k].jump; }
int problem_band(int k) { return problems()[k].band; }
int problem_stiff(int k) { return problems()[k].stiff; }
void problem_start(int k, double* y) { std::copy(problems()[k].start.begin(), problems()[k].start.end(), y); }
void problem_nominal(int k, double* scale) {
    std::copy(problems()[k].nominal.begin(), problems()[k].nominal.end(), scale);
}
void problem_rates(int k, int late, double t, const double* y, double* f) {
    problems()[k].rates(problem_size(k), late != 0, t, y, f);
}
