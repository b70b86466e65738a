/* The neighbour technique of the LAPAN paper once more, in C, as flight software might have it: the first catalogue star
 * that reaches Fn and Fn2. Its catalogue is the table of figure 2-5 (gse catalog export --flight), as `config`. */
#include "gse_identifier.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

GSE_IDENTIFIER("onboard neighbour", "1.0");

enum { MIN_FIT = 6, MOST_CANDIDATES = 64, MOST = GSE_MOST_OBJECTS };
static const double TOLERANCE_PX = 1.5;

typedef struct { int32_t star, urad; } Neighbour;
typedef struct { int stars; int64_t *id; double (*icrs)[3]; int *first; Neighbour *neighbour; } Table;
typedef struct { int object, star; } Candidate;

/* ---- the table ---- */

typedef struct { int64_t id; int row; } Row;
static int by_id(const void *a, const void *b) {
    int64_t x = ((const Row *)a)->id, y = ((const Row *)b)->id;
    return (x > y) - (x < y);
}

static Table *read_table(const char *text) {
    Table *t = calloc(1, sizeof *t);
    size_t lines = 1, fields = 1;
    for (const char *p = text; *p; p++) { lines += *p == '\n'; fields += *p == ','; }
    t->id = malloc(lines * sizeof *t->id);
    t->icrs = malloc(lines * sizeof *t->icrs);
    t->first = malloc((lines + 1) * sizeof *t->first);
    t->neighbour = malloc(fields * sizeof *t->neighbour);
    int64_t *name = malloc(fields * sizeof *name);
    int used = 0;
    for (const char *line = text; *line; line = strchr(line, '\n') + 1) {
        if (*line == '#' || *line == 'i') continue;
        char *p;
        t->id[t->stars] = strtoll(line, &p, 10);
        for (int k = 0; k < 3; k++) t->icrs[t->stars][k] = strtod(p + 1, &p);
        strtod(p + 1, &p); /* the magnitude */
        t->first[t->stars++] = used;
        for (long n = strtol(p + 1, &p, 10); n > 0; n--, used++) {
            name[used] = strtoll(p + 1, &p, 10);
            t->neighbour[used].urad = (int32_t)strtol(p + 1, &p, 10);
        }
    }
    t->first[t->stars] = used;
    Row *row = malloc(lines * sizeof *row);
    for (int i = 0; i < t->stars; i++) row[i] = (Row){t->id[i], i};
    qsort(row, t->stars, sizeof *row, by_id);
    for (int k = 0; k < used; k++) {
        Row key = {name[k], 0};
        t->neighbour[k].star = ((Row *)bsearch(&key, row, t->stars, sizeof *row, by_id))->row;
    }
    free(row);
    free(name);
    return t;
}

/* ---- geometry ---- */

static double angle_urad(const double *a, const double *b) {
    double x = a[1] * b[2] - a[2] * b[1], y = a[2] * b[0] - a[0] * b[2], z = a[0] * b[1] - a[1] * b[0];
    return 1e6 * atan2(sqrt(x * x + y * y + z * z), a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
}

static void direction(const gse_sensor *s, const gse_object *o, double *v) {
    double x = s->x.factor * o->x + s->x.zero - s->principal_point_px[0];
    double y = s->y.factor * o->y + s->y.zero - s->principal_point_px[1];
    double f = s->focal_length_px, norm = sqrt(x * x + y * y + f * f);
    v[0] = (s->mirrored ? -x : x) / norm, v[1] = y / norm, v[2] = f / norm;
}

/* Objects brightest first, the first of equals first; those at the place of a brighter one are left out. */
static int distinct(const gse_sensor *s, const gse_panorama *p, double v[][3], int *place) {
    int order[MOST], count = 0;
    for (int i = 0; i < (int)p->count; i++) {
        int k = i;
        for (; k > 0 && p->objects[order[k - 1]].index < p->objects[i].index; k--) order[k] = order[k - 1];
        order[k] = i;
    }
    for (int i = 0; i < (int)p->count; i++) {
        int is_new = 1;
        direction(s, &p->objects[order[i]], v[count]);
        for (int k = 0; k < count; k++) is_new &= angle_urad(v[k], v[count]) > 1.0;
        if (is_new) place[count++] = order[i];
    }
    return count;
}

/* The rotation that takes stars to objects: Davenport's matrix, Jacobi's eigenvectors; the residual in radians. */
static double attitude(double b[][3], double r[][3], int n, double a[3][3]) {
    double k[4][4] = {{0}}, e[4][4] = {{0}}, m[3][3] = {{0}};
    for (int i = 0; i < n; i++)
        for (int p = 0; p < 3; p++)
            for (int q = 0; q < 3; q++) m[p][q] += b[i][p] * r[i][q] / n;
    double trace = m[0][0] + m[1][1] + m[2][2];
    for (int p = 0; p < 3; p++) {
        for (int q = 0; q < 3; q++) k[p][q] = m[p][q] + m[q][p] - (p == q ? trace : 0);
        k[p][3] = k[3][p] = m[(p + 1) % 3][(p + 2) % 3] - m[(p + 2) % 3][(p + 1) % 3];
    }
    k[3][3] = trace;
    for (int i = 0; i < 4; i++) e[i][i] = 1;
    for (int sweep = 0; sweep < 20; sweep++)
        for (int p = 0; p < 3; p++)
            for (int q = p + 1; q < 4; q++) {
                if (k[p][q] == 0) continue;
                double theta = (k[q][q] - k[p][p]) / (2 * k[p][q]);
                double t = (theta < 0 ? -1 : 1) / (fabs(theta) + sqrt(theta * theta + 1));
                double c = 1 / sqrt(t * t + 1), s = t * c;
                for (int i = 0; i < 4; i++) {
                    double x = k[i][p], y = k[i][q];
                    k[i][p] = c * x - s * y, k[i][q] = s * x + c * y;
                }
                for (int i = 0; i < 4; i++) {
                    double x = k[p][i], y = k[q][i];
                    k[p][i] = c * x - s * y, k[q][i] = s * x + c * y;
                    x = e[i][p], y = e[i][q];
                    e[i][p] = c * x - s * y, e[i][q] = s * x + c * y;
                }
            }
    int best = 0;
    for (int i = 1; i < 4; i++) if (k[i][i] > k[best][best]) best = i;
    double x = e[0][best], y = e[1][best], z = e[2][best], w = e[3][best], sum = 0;
    double rotation[3][3] = {{w * w + x * x - y * y - z * z, 2 * (x * y + w * z), 2 * (x * z - w * y)},
                             {2 * (x * y - w * z), w * w - x * x + y * y - z * z, 2 * (y * z + w * x)},
                             {2 * (x * z + w * y), 2 * (y * z - w * x), w * w - x * x - y * y + z * z}};
    memcpy(a, rotation, sizeof rotation);
    for (int i = 0; i < n; i++)
        for (int p = 0; p < 3; p++) {
            double d = b[i][p] - a[p][0] * r[i][0] - a[p][1] * r[i][1] - a[p][2] * r[i][2];
            sum += d * d;
        }
    return sqrt(sum / n);
}

static void set_angles(double a[3][3], gse_answer *answer) {
    const double deg = 180 / acos(-1.0), *z = a[2];
    double ra = atan2(z[1], z[0]), east = sin(ra) * a[1][0] - cos(ra) * a[1][1];
    double north = -hypot(z[0], z[1]) * a[1][2] + z[2] * (cos(ra) * a[1][0] + sin(ra) * a[1][1]);
    answer->ra_deg = fmod(deg * ra + 360, 360);
    answer->de_deg = deg * atan2(z[2], hypot(z[0], z[1]));
    answer->roll_deg = fmod(deg * atan2(east, north) + 360, 360);
}

/* ---- level 1, eq 2-5 ---- */

static int level_1(const Table *t, int star, const double *distance, const int *other, int others, double d_m,
                   Candidate *candidate, int *count) {
    int fit = 0, low = 0;
    *count = 0;
    for (int k = t->first[star]; k < t->first[star + 1]; k++) {
        double urad = t->neighbour[k].urad;
        int hit = 0;
        while (low < others && distance[low] <= urad - d_m) low++;
        for (int i = low; i < others && distance[i] < urad + d_m; i++) {
            if (!(fabs(urad - distance[i]) < d_m)) continue;
            hit = 1;
            if (*count < MOST_CANDIDATES && fit < MOST_CANDIDATES)
                candidate[(*count)++] = (Candidate){other[i], t->neighbour[k].star};
        }
        fit += hit;
    }
    return fit;
}

/* ---- level 2, eq 2-6: the largest group that fits pairwise, grown from each candidate ---- */

static int degree(uint64_t word) { return __builtin_popcountll(word); }

static int most_agreements(const uint64_t *agrees, int n, uint64_t among, uint64_t counted) {
    int best = -1, most = -1;
    for (int i = 0; i < n; i++)
        if (among >> i & 1 && degree(agrees[i] & counted) > most) best = i, most = degree(agrees[i] & counted);
    return best;
}

static uint64_t able(const uint64_t *agrees, int n, uint64_t alive, int fewest) {
    for (uint64_t before = 0; before != alive;) {
        before = alive;
        for (int i = 0; i < n; i++) if (degree(agrees[i] & alive) + 1 < fewest) alive &= ~((uint64_t)1 << i);
    }
    return alive;
}

static uint64_t level_2(const Table *t, const Candidate *c, int n, double v[][3], double d_m) {
    uint64_t agrees[MOST_CANDIDATES] = {0}, best = 0;
    for (int i = 0; i < n; i++)
        for (int j = 0; j < i; j++) {
            if (c[i].object == c[j].object || c[i].star == c[j].star) continue;
            double stars = rint(angle_urad(t->icrs[c[i].star], t->icrs[c[j].star]));
            if (!(fabs(stars - angle_urad(v[c[i].object], v[c[j].object])) < d_m)) continue;
            agrees[i] |= (uint64_t)1 << j, agrees[j] |= (uint64_t)1 << i;
        }
    int size = MIN_FIT - 1;
    uint64_t alive = able(agrees, n, n == 64 ? ~(uint64_t)0 : ((uint64_t)1 << n) - 1, MIN_FIT), untried = alive;
    while (untried) {
        int seed = most_agreements(agrees, n, untried, alive);
        untried &= ~((uint64_t)1 << seed);
        uint64_t group = (uint64_t)1 << seed, room = agrees[seed] & alive;
        while (room) {
            int member = most_agreements(agrees, n, room, room);
            group |= (uint64_t)1 << member, room &= agrees[member];
        }
        if (degree(group) <= size) continue;
        best = group, size = degree(group), alive = able(agrees, n, alive, size + 1), untried &= alive;
    }
    return best;
}

static int solve(const Table *t, int alpha, int star, const Candidate *c, int n, uint64_t group, double v[][3],
                 const int *place, double d_m, gse_answer *answer) {
    double b[MOST_CANDIDATES + 1][3], r[MOST_CANDIDATES + 1][3], a[3][3];
    int used = 0;
    for (int i = -1; i < n; i++) {
        if (i >= 0 && !(group >> i & 1)) continue;
        int object = i < 0 ? alpha : c[i].object, named = i < 0 ? star : c[i].star;
        memcpy(b[used], v[object], sizeof *b);
        memcpy(r[used], t->icrs[named], sizeof *r);
        answer->matches[used].object = place[object], answer->matches[used++].star = t->id[named];
    }
    if (attitude(b, r, used, a) > 1e-6 * d_m) return GSE_NO_MATCH;
    answer->matched = used;
    set_angles(a, answer);
    return GSE_IDENTIFIED;
}

static int first_fit(const Table *t, double v[][3], const int *place, int n, double d_m, gse_answer *answer) {
    for (int alpha = 0; alpha < n; alpha++) {
        double distance[MOST];
        int other[MOST], others = 0;
        for (int i = 0; i < n; i++) {
            if (i == alpha) continue;
            double d = angle_urad(v[alpha], v[i]);
            int k = others++;
            for (; k > 0 && distance[k - 1] > d; k--) distance[k] = distance[k - 1], other[k] = other[k - 1];
            distance[k] = d, other[k] = i;
        }
        for (int star = 0; star < t->stars; star++) {
            Candidate candidate[MOST_CANDIDATES];
            int count;
            if (level_1(t, star, distance, other, others, d_m, candidate, &count) < MIN_FIT) continue;
            uint64_t group = level_2(t, candidate, count, v, d_m);
            if (group) return solve(t, alpha, star, candidate, count, group, v, place, d_m, answer);
        }
    }
    return GSE_NO_MATCH;
}

int identify(const gse_panorama *panorama, gse_answer *answer, void *given) {
    gse_config *config = given;
    if (panorama->version != GSE_IDENTIFIER_ABI || !config->data) return 1;
    if (!config->state) config->state = read_table((const char *)config->data);
    double v[MOST][3], d_m = 2e6 * atan2(TOLERANCE_PX / 2, config->sensor->focal_length_px);
    int place[MOST], count = distinct(config->sensor, panorama, v, place);
    answer->version = GSE_IDENTIFIER_ABI;
    answer->frame_no = panorama->frame_no;
    answer->status = panorama->count < MIN_FIT + 1 ? GSE_TOO_FEW
                                                   : first_fit(config->state, v, place, count, d_m, answer);
    return 0;
}
