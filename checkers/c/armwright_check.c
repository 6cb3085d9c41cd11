/* Checker of witnesses: proves from one file that a robot's motion is free and within its limits.
 *
 * It shares no line with the program that wrote the file, nor with the checker in Python, and was
 * written from the page docs/witness.md of Armwright. Numbers are doubles with a bound of all that
 * was rounded off (struct ball); the bound of each operation is fixed beforehand from the unit of
 * rounding, so that no rounding mode is switched. Assumed are IEEE 754 doubles, lowest byte first,
 * sqrt rounded correctly, sin and cos right to 4 units of rounding of 1. It reads the compact form.
 *
 *     cc -O2 -ffp-contract=off -o armwright-check armwright_check.c -lm
 *     armwright-check FILE, or - for what comes in
 *
 * Exit code: 0 all is proved, 2 all but what the file names as unwitnessed, 1 rejected, 3 no use.
 */

#include <math.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define U 0x1p-53             /* unit of rounding */
#define UP (1.0 + 0x1p-48)    /* more than bounds of a few operations can have lost themselves */
#define TINY 1e-300           /* more than products can lose by underflow */
#define LIMIT_TOLERANCE 1e-8  /* share of a limit, and [rad or m] of a position */
#define JUMP 1e-8             /* of position and velocity between pieces */
#define ACCELERATION_JUMP 2e-6
#define END 1e-9              /* of the motion's ends from start and goal */
#define ORTHONORMAL 1e-11     /* of R'R from 1 */
#define FRAMES (1.0 + 0x1p-20) /* growth of bounds for that */
#define HALVINGS 60
#define MAX_TERMS 64
#define MAX_DEPTH 32
#define MAX_PATH 4096

static void fail(const char *form, ...) {
    va_list values;
    va_start(values, form);
    printf("rejected: ");
    vprintf(form, values);
    printf("\n");
    va_end(values);
    exit(1);
}

static void *room(size_t count, size_t size) {
    void *block = calloc(count ? count : 1, size);
    if (!block) fail("no memory");
    return block;
}

typedef struct { double m, r; } ball; /* all numbers within r of m */

static ball exact(double x) { return (ball){x, 0.0}; }
static double hi(ball a) { return nextafter(a.m + a.r, INFINITY); }
static double lo(ball a) { return nextafter(a.m - a.r, -INFINITY); }
static double above(double sum) { return sum + fabs(sum) * 0x1p-50 + TINY; }
static double size(ball a) { return (fabs(a.m) + a.r) * UP; }

static ball add(ball a, ball b) {
    double m = a.m + b.m;
    return (ball){m, (a.r + b.r + U * fabs(m)) * UP};
}

static ball sub(ball a, ball b) { return add(a, (ball){-b.m, b.r}); }
static ball mul(ball a, ball b) {
    double m = a.m * b.m;
    double r = fabs(a.m) * b.r + a.r * (fabs(b.m) + b.r) + U * fabs(m);
    return (ball){m, r * UP + TINY};
}

static ball dot(const ball *a, const ball *b) {
    return add(add(mul(a[0], b[0]), mul(a[1], b[1])), mul(a[2], b[2]));
}

static double length(const ball *v) { return above(sqrt(hi(dot(v, v)))); }

typedef struct node {
    enum { NONE, TEXT, LIST, OBJECT, NUMBERS } kind;
    const char *key, *text;
    size_t count, rank, sizes[3]; /* of items; of numbers, and of the lists that these stand in */
    struct node *items;
    double *numbers; /* NaN for none */
} node;

static const unsigned char *at, *end;

static unsigned byte(void) {
    if (at == end) fail("the file ends early");
    return *at++;
}

static uint64_t groups(void) {
    uint64_t value = 0, part = 128;
    for (int shift = 0; part > 127; shift += 7) {
        if (shift > 49) fail("a count is too long");
        part = byte();
        value |= (part & 127) << shift;
    }
    return value;
}

static size_t length_of(void) { /* of what takes a byte an item at least */
    uint64_t count = groups();
    if (count > (uint64_t)(end - at)) fail("the file ends early");
    return (size_t)count;
}

static const char *string(void) {
    size_t count = length_of();
    char *text = memcpy(room(count + 1, 1), at, count);
    at += count;
    if (strlen(text) != count) fail("a text has a zero in it");
    return text;
}

static double decoded(void) {
    unsigned first = byte();
    uint64_t bits = 0;
    double x, power = 1.0;
    if (first < 128) return first - 64.0;
    if (first < 192) return 256.0 * (first - 128) + byte();
    if (first < 208) {
        bits = groups();
        if (bits >> 53) fail("a decimal is too long");
        x = (double)(bits / 2);
        for (; first > 192; first--) power *= 10.0; /* exact below 10^23 */
        return (bits % 2 ? -x - 1.0 : x) / power;
    }
    if (first == 254) return NAN;
    if (first != 255) fail("there are no numbers that begin with %u", first);
    for (int k = 0; k < 64; k += 8) bits |= (uint64_t)byte() << k;
    memcpy(&x, &bits, sizeof x);
    if (!isfinite(x)) fail("a number is not finite");
    return x;
}

static void parse(node *one, int depth) {
    unsigned kind = byte();
    if (depth > MAX_DEPTH) fail("the file is nested too deep");
    if (kind > NUMBERS) fail("there are no values of kind %u", kind);
    one->kind = kind;
    if (kind == TEXT) one->text = string();
    else if (kind == LIST || kind == OBJECT) {
        one->count = length_of();
        one->items = room(one->count, sizeof *one->items);
        for (size_t k = 0; k < one->count; k++) {
            if (kind == OBJECT) one->items[k].key = string();
            parse(one->items + k, depth + 1);
        }
    } else if (kind == NUMBERS) {
        one->rank = byte(), one->count = 1;
        if (one->rank > 3) fail("numbers are nested too deep");
        for (size_t k = 0; k < one->rank; k++) {
            one->sizes[k] = length_of();
            if (k && !one->sizes[k]) fail("numbers are in empty lists");
            if (one->sizes[k] && one->count > (size_t)(end - at) / one->sizes[k]) fail("too many numbers");
            one->count *= one->sizes[k];
        }
        one->numbers = room(one->count, sizeof *one->numbers);
        for (size_t k = 0; k < one->count; k++) one->numbers[k] = decoded();
    }
}

static const node *find(const node *object, const char *key) {
    const node *found = NULL;
    if (object->kind != OBJECT) fail("there is no object with %s", key);
    for (size_t k = 0; k < object->count; k++)
        if (!strcmp(object->items[k].key, key)) {
            if (found) fail("%s stands twice", key);
            found = object->items + k;
        }
    return found;
}

/* A field; an empty list of anything may be written as one of numbers. */
static const node *get(const node *object, const char *key, int kind) {
    const node *found = find(object, key);
    if (!found || ((int)found->kind != kind && (kind != LIST || found->kind != NUMBERS || found->count)))
        fail("field %s is missing or malformed", key);
    return found;
}

static const char *text(const node *object, const char *key) { return get(object, key, TEXT)->text; }

/* Numbers in lists in lists, rank of these, the innermost of so many; perhaps none of them. */
static const node *table(const node *object, const char *key, size_t rank, size_t last, int bare) {
    const node *found = get(object, key, NUMBERS);
    if (found->count && (found->rank != rank || (last && found->sizes[rank - 1] != last)))
        fail("%s: numbers in other lists", key);
    for (size_t k = 0; k < found->count; k++)
        if (!bare && isnan(found->numbers[k])) fail("%s: a number is missing", key);
    return found;
}

static const double *sequence(const node *object, const char *key, size_t count) {
    const node *found = table(object, key, 1, count, 0);
    if (found->count != count) fail("%s: not %zu numbers", key, count);
    return found->numbers;
}

static double number(const node *object, const char *key) {
    return table(object, key, 0, 0, 0)->numbers[0];
}

static long index_of(double x, long first, long stop, const char *what) {
    if (!(x >= first && x < stop) || x != floor(x)) fail("there is no %s %g", what, x);
    return (long)x;
}

typedef struct { int turns, parent, leader; ball factor, offset, T[3][4]; } body;
typedef struct {
    const char *name;
    long label; /* number of the name */
    char kind;  /* first letter: hull, cylinder, cone ('o'), half-space ('-') */
    int body;
    size_t count; /* of corners, in fours: their x, y and z */
    double (*corners)[3][4], most[3], radius, half, rounding, margin, reach;
    ball T[3][4], center[3];
} solid;
typedef struct { long cell; int a, b; enum kind { PLANE, HALF_SPACE, LEFT_OPEN } kind; double way[3]; } fact;
typedef struct { long a, b; double begin, end; } span;

static body *bodies;
static solid *solids;
static long n, body_count, solid_count, pieces, terms;
static const double *knots;
static double choose[MAX_TERMS][MAX_TERMS]; /* exact below 2^53 */
static ball *coefficients; /* of piece i, joint j: terms numbers from (i n + j) terms on */

static const ball *polynomial(long i, long j) { return coefficients + (i * n + j) * terms; }

static void read_transform(const node *object, ball T[3][4], const char *owner, long k) {
    const double *numbers = sequence(object, "transform", 12);
    for (int i = 0; i < 12; i++) T[i / 4][i % 4] = exact(numbers[i]);
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++) {
            ball sum = exact(a == b ? -1.0 : 0.0);
            for (int i = 0; i < 3; i++) sum = add(sum, mul(T[i][a], T[i][b]));
            if (!(size(sum) <= ORTHONORMAL)) fail("the frame of %s %ld is no rotation", owner, k);
        }
}

static void read_bodies(const node *rows) {
    body_count = (long)rows->count;
    bodies = room(rows->count, sizeof *bodies);
    for (long k = 0; k < body_count; k++) n += !find(rows->items + k, "follows");
    if (!n) fail("there are no joints");
    for (long k = 0; k < body_count; k++) {
        const node *joint = rows->items + k;
        const char *kind = text(joint, "kind");
        body *one = bodies + k;
        one->turns = !strcmp(kind, "revolute");
        if (!one->turns && strcmp(kind, "prismatic")) fail("joint %ld is of no kind", k);
        one->parent = (int)index_of(number(joint, "parent"), -1, k, "body before");
        one->leader = (int)k, one->factor = exact(1.0), one->offset = exact(0.0);
        if (find(joint, "follows")) {
            const double *follows = sequence(joint, "follows", 3);
            one->leader = (int)index_of(follows[0], 0, n, "joint to follow");
            one->factor = exact(follows[1]), one->offset = exact(follows[2]);
        } else if (k >= n) fail("a joint of its own comes behind one that follows another");
        read_transform(joint, one->T, "joint", k);
    }
}

static void read_hull(solid *one, const node *corners, double middle[3]) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    size_t last = corners->count / 3 - 1;
    if (!corners->count) fail("solid %s has no corners", one->name);
    one->count = last / 4 + 1;
    one->corners = room(one->count, sizeof *one->corners);
    for (size_t v = 0; v < 4 * one->count; v++) /* the last one stands for those that fill the fours */
        for (int k = 0; k < 3; k++) {
            double x = corners->numbers[3 * (v < last ? v : last) + (size_t)k];
            one->corners[v / 4][k][v % 4] = x;
            low[k] = fmin(low[k], x), high[k] = fmax(high[k], x);
            one->most[k] = fmax(one->most[k], fabs(x));
        }
    for (int k = 0; k < 3; k++) middle[k] = 0.5 * (low[k] + high[k]);
    for (size_t v = 0; v <= last; v++) {
        ball away[3];
        for (int k = 0; k < 3; k++)
            away[k] = sub(exact(corners->numbers[3 * v + (size_t)k]), exact(middle[k]));
        one->reach = fmax(one->reach, length(away));
    }
}

static void read_solids(const node *rows) {
    solid_count = (long)rows->count;
    solids = room(rows->count, sizeof *solids);
    for (long k = 0; k < solid_count; k++) {
        const node *row = rows->items + k;
        solid *one = solids + k;
        const char *kind = text(row, "kind");
        double middle[3] = {0.0, 0.0, 0.0};
        one->name = text(row, "name");
        for (one->label = 0; strcmp(solids[one->label].name, one->name); one->label++) {}
        one->body = (int)index_of(number(row, "body"), -1, body_count, "body");
        read_transform(row, one->T, "solid", k);
        one->rounding = number(row, "rounding");
        one->margin = find(row, "margin") ? number(row, "margin") : 0.0;
        if (!strcmp(kind, "hull")) {
            one->kind = 'h';
            read_hull(one, table(row, "vertices", 2, 3, 0), middle);
        } else if (!strcmp(kind, "half-space")) {
            one->kind = '-';
            if (one->body != -1) fail("half-space %s moves", one->name);
        } else {
            one->kind = !strcmp(kind, "cylinder") ? 'c' : 'o';
            if (one->kind == 'o' && strcmp(kind, "cone")) fail("solids %s are not known", kind);
            one->radius = number(row, "radius");
            one->half = number(row, "half_height");
            ball sizes[3] = {exact(one->radius), exact(one->half), exact(0.0)};
            one->reach = length(sizes);
        }
        if (!(one->rounding >= 0.0 && one->margin >= 0.0 && one->radius >= 0.0 && one->half >= 0.0))
            fail("solid %s has a negative size", one->name);
        one->reach *= FRAMES;
        for (int i = 0; i < 3; i++) {
            ball place[3] = {exact(middle[0]), exact(middle[1]), exact(middle[2])};
            one->center[i] = add(dot(one->T[i], place), one->T[i][3]);
        }
    }
}

static void read_motion(const node *document) {
    const node *rows = table(document, "polynomials", 3, 0, 0);
    if (!rows->count || rows->sizes[1] != (size_t)n) fail("there are no polynomials of all joints");
    pieces = (long)rows->sizes[0], terms = (long)rows->sizes[2];
    if (terms > MAX_TERMS) fail("polynomials have too many terms");
    knots = sequence(document, "knots", rows->sizes[0] + 1);
    for (long i = 0; i <= pieces; i++)
        if (i ? !(knots[i] > knots[i - 1]) : knots[0] != 0.0) fail("knots do not ascend from 0");
    coefficients = room(rows->count, sizeof *coefficients);
    for (size_t k = 0; k < rows->count; k++) coefficients[k] = exact(rows->numbers[k]);
    for (int i = 0; i < terms; i++)
        for (int m = 0; m <= i; m++)
            choose[i][m] = !m || m == i ? 1.0 : choose[i - 1][m - 1] + choose[i - 1][m];
    if (choose[terms - 1][(terms - 1) / 2] > 0x1p53) fail("polynomials have too many terms");
}

static ball piece_length(long i) { return sub(exact(knots[i + 1]), exact(knots[i])); }

static ball value(const ball *c, long count, ball s) {
    ball total = exact(0.0);
    for (long k = count - 1; k >= 0; k--) total = add(mul(total, s), c[k]);
    return total;
}

/* The polynomial is a mean of these at every instant of [s, s + h]. */
static void bernstein(const ball *c, long count, ball s, ball h, ball *points) {
    ball a[MAX_TERMS], scale = exact(1.0);
    memcpy(a, c, (size_t)count * sizeof *a);
    for (long first = 0; first + 1 < count; first++)
        for (long i = count - 2; i >= first; i--) a[i] = add(a[i], mul(s, a[i + 1]));
    for (long i = 0; i < count; i++) {
        a[i] = mul(a[i], scale), scale = mul(scale, h);
    }
    for (long i = 0; i < count; i++) {
        points[i] = exact(0.0);
        for (long m = 0; m <= i; m++) {
            double share = choose[i][m] / choose[count - 1][m];
            points[i] = add(points[i], mul(a[m], (ball){share, 2.0 * U * share}));
        }
    }
}

static int stays_below(const ball *c, long count, ball s, ball h, double bound, int depth) {
    ball points[MAX_TERMS], half = mul(h, exact(0.5));
    double most = -INFINITY;
    bernstein(c, count, s, h, points);
    for (long k = 0; k < count; k++) most = fmax(most, isnan(points[k].m) ? INFINITY : hi(points[k]));
    if (most <= bound) return 1;
    if (!(lo(points[0]) <= bound && lo(points[count - 1]) <= bound) || depth == HALVINGS) return 0;
    return stays_below(c, count, s, half, bound, depth + 1) &&
           stays_below(c, count, add(s, half), half, bound, depth + 1);
}

static long derive(ball *c, long count) {
    for (long k = 1; k < count; k++) c[k - 1] = mul(c[k], exact((double)k));
    if (count == 1) c[0] = exact(0.0);
    return count > 1 ? count - 1 : 1;
}

static void check_limit(long order, long j, double sign, double bound) {
    double most = bound + LIMIT_TOLERANCE * (order ? bound : 1.0);
    for (long i = 0; i < pieces; i++) {
        ball c[MAX_TERMS];
        long count = terms;
        for (long k = 0; k < terms; k++) c[k] = mul(polynomial(i, j)[k], exact(sign));
        for (long k = 0; k < order; k++) count = derive(c, count);
        if (!stays_below(c, count, exact(0.0), piece_length(i), most, 0))
            fail("derivative %ld of joint %ld is not proved below its limit in piece %ld", order, j, i);
    }
}

static int check_limits(const node *limits) {
    static const char *quantities[] = {"position", "velocity", "acceleration", "jerk"};
    int smooth = 0;
    for (long order = 0; order < 4; order++) {
        size_t sides = order ? 1 : 2;
        const node *rows = table(limits, quantities[order], sides, order ? 0 : 2, 1);
        if (rows->count != (size_t)n * sides) fail("limits of %s are missing", quantities[order]);
        for (long j = 0; j < n; j++) {
            double low = rows->numbers[j * (long)sides], high = rows->numbers[(j + 1) * (long)sides - 1];
            if (!isnan(high)) check_limit(order, j, 1.0, high);
            if (!isnan(low)) check_limit(order, j, -1.0, order ? low : -low);
            smooth |= order == 3 && !isnan(high);
        }
    }
    return smooth;
}

static void check_joins(int orders) {
    static const double jumps[] = {JUMP, JUMP, ACCELERATION_JUMP};
    for (long i = 0; i + 1 < pieces; i++)
        for (long j = 0; j < n; j++) {
            ball a[MAX_TERMS], b[MAX_TERMS];
            long count = terms;
            memcpy(a, polynomial(i, j), (size_t)terms * sizeof *a);
            memcpy(b, polynomial(i + 1, j), (size_t)terms * sizeof *b);
            for (int order = 0; order < orders; order++) {
                ball jump = sub(value(a, count, piece_length(i)), b[0]);
                if (!(size(jump) <= jumps[order]))
                    fail("derivative %d of joint %ld jumps after piece %ld", order, j, i);
                derive(a, count);
                count = derive(b, count);
            }
        }
}

static void check_end(const node *document, const char *name, long piece, ball s) {
    const double *told = sequence(document, name, (size_t)n);
    for (long j = 0; j < n; j++) {
        ball away = sub(value(polynomial(piece, j), terms, s), exact(told[j]));
        if (!(size(away) <= END)) fail("the motion misses its %s at joint %ld", name, j);
    }
}

static ball *steps;   /* of body k: count numbers from k count on */
static double *most, *blur; /* the largest size and radius of these */
static ball (*frames)[3][4];
static long count;
static double *heights[2];

static void place_body(long k, ball q) {
    const body *one = bodies + k;
    ball c = {cos(q.m), q.r + 4.0 * U}, s = {sin(q.m), q.r + 4.0 * U};
    for (int i = 0; i < 3; i++) {
        const ball *R = one->T[i];
        ball *F = frames[k][i];
        memcpy(F, R, sizeof one->T[i]);
        if (!one->turns) F[3] = add(R[3], mul(R[2], q));
        else F[0] = add(mul(R[0], c), mul(R[1], s)), F[1] = sub(mul(R[1], c), mul(R[0], s));
    }
}

static void enter_cell(double begin, double end) {
    double middle = 0.5 * (begin + end);
    long first = 0, last, used = 0;
    while (knots[first + 1] <= begin) first++;
    for (last = first; knots[last + 1] < end;) last++;
    for (long i = first; i <= last; i++) if (knots[i] <= middle) used = i;
    count = (last - first + 1) * terms;
    steps = realloc(steps, (size_t)(body_count * count) * sizeof *steps);
    for (int k = 0; k < 2; k++) heights[k] = realloc(heights[k], (size_t)count * sizeof **heights);
    if (!steps || !heights[0] || !heights[1]) fail("no memory");
    for (long k = 0; k < body_count; k++) {
        const body *one = bodies + k;
        /* Any number would do. */
        ball q = exact(value(polynomial(used, one->leader), terms, exact(middle - knots[used])).m);
        most[k] = blur[k] = 0.0;
        for (long i = first; i <= last; i++) {
            double low = fmax(begin, knots[i]), high = fmin(end, knots[i + 1]);
            ball *own = steps + k * count + (i - first) * terms;
            ball s = sub(exact(low), exact(knots[i])), h = sub(exact(high), exact(low));
            bernstein(polynomial(i, one->leader), terms, s, h, own);
            for (long m = 0; m < terms; m++) {
                own[m] = mul(one->factor, sub(own[m], q));
                most[k] = fmax(most[k], isnan(own[m].m) ? INFINITY : size(own[m]));
                blur[k] = fmax(blur[k], own[m].r);
            }
        }
        place_body(k, add(mul(one->factor, q), one->offset));
    }
}

/* A direction with its offset, in a frame. */
static void carry(const ball F[3][4], ball *w) {
    ball turned[4];
    for (int k = 0; k < 4; k++) {
        ball sum = add(add(mul(F[0][k], w[0]), mul(F[1][k], w[1])), mul(F[2][k], w[2]));
        turned[k] = k < 3 ? sum : add(w[3], sum);
    }
    memcpy(w, turned, sizeof turned);
}

/* An upper bound of the core's support along a direction of its own frame. */
static double support(const solid *one, const ball *x) {
    double lost = 0.0;
    if (one->kind == 'h') {
        double most[4] = {-INFINITY, -INFINITY, -INFINITY, -INFINITY};
        for (size_t v = 0; v < one->count; v++)
            for (int k = 0; k < 4; k++) {
                const double(*p)[4] = one->corners[v];
                double height = x[0].m * p[0][k] + x[1].m * p[1][k] + x[2].m * p[2][k];
                most[k] = height > most[k] ? height : most[k];
            }
        double best = fmax(fmax(most[0], most[1]), fmax(most[2], most[3]));
        /* Three products and two sums: 5 units of the sum of sizes are more than they lose. */
        for (int k = 0; k < 3; k++) lost += one->most[k] * (x[k].r + 5.0 * U * fabs(x[k].m));
        return above(best + lost * UP + TINY);
    }
    double rim = above(one->radius * above(sqrt(hi(add(mul(x[0], x[0]), mul(x[1], x[1]))))));
    if (one->kind == 'c') return above(above(one->half * size(x[2])) + rim);
    double apex = hi(mul(exact(one->half), x[2])), foot = -lo(mul(exact(one->half), x[2]));
    return fmax(apex, above(rim + foot));
}

/* Upper bounds whose means bound the solid along w to first order; how many, and of the rest. */
static long reach(const solid *one, int meeting, const ball *way, double *found, double *rest) {
    static int path[MAX_PATH];
    static ball tilts[MAX_PATH][4]; /* the direction's turn by each joint, and its offset */
    ball center[3], w[4];
    double far = 0.0, bound = 0.0;
    int joints = 0;
    memcpy(center, one->center, sizeof center);
    memcpy(w, way, 3 * sizeof *w), w[3] = exact(0.0);
    for (int k = one->body; k != meeting; k = bodies[k].parent) {
        if (joints == MAX_PATH) fail("there are too many joints");
        path[joints++] = k;
        if (bodies[k].turns) {
            ball arm[3] = {center[0], center[1], exact(0.0)};
            double lever = above(above(length(arm) + one->reach) + far);
            bound = above(bound + above(most[k] * above(far + above(0.5 * lever * most[k]))));
            far = above(far + above(lever * most[k]));
        } else far = above(far + most[k]);
        ball moved[3];
        for (int i = 0; i < 3; i++) moved[i] = add(dot(frames[k][i], center), frames[k][i][3]);
        memcpy(center, moved, sizeof center);
    }
    *rest = above(above(bound * FRAMES) * length(way));
    for (int row = joints - 1; row >= 0; row--) {
        int k = path[row];
        for (int i = joints - 1; i > row; i--) carry(frames[k], tilts[i]);
        carry(frames[k], w);
        for (int i = 0; i < 4; i++) tilts[row][i] = exact(0.0);
        if (bodies[k].turns) tilts[row][0] = w[1], tilts[row][1] = (ball){-w[0].m, w[0].r};
        else tilts[row][3] = w[2];
    }
    carry(one->T, w);
    for (int row = 0; row < joints; row++) carry(one->T, tilts[row]);
    /* What is lost at most in w + sum of steps times tilts, whichever steps these are. */
    double round = above(one->rounding * length(way)), lost[4];
    for (int k = 0; k < 4; k++) {
        double top = size(w[k]);
        lost[k] = w[k].r;
        for (int row = 0; row < joints; row++) {
            double turn = size(tilts[row][k]), far = most[path[row]], blurred = blur[path[row]];
            top = above(top + above(far * turn));
            lost[k] = above(lost[k] + above(above(far * tilts[row][k].r) + above(blurred * turn)));
        }
        lost[k] = above(lost[k] + above((joints + 2) * U * top));
        if (!isfinite(lost[k])) fail("numbers are too large");
    }
    for (long i = 0; i < (joints ? count : 1); i++) {
        double sum[4] = {w[0].m, w[1].m, w[2].m, w[3].m};
        for (int row = 0; row < joints; row++) {
            double q = steps[path[row] * count + i].m;
            for (int k = 0; k < 4; k++) sum[k] += q * tilts[row][k].m;
        }
        ball d[3] = {{sum[0], lost[0]}, {sum[1], lost[1]}, {sum[2], lost[2]}};
        found[i] = above(above(support(one, d) + hi((ball){sum[3], lost[3]})) + round);
    }
    return joints ? count : 1;
}

/* A lower bound of the gap of a fact all over the cell that was entered. */
static double gap(const fact *one) {
    const solid *a = solids + one->a, *b = solids + one->b;
    int meeting = a->body, other = b->body;
    ball way[3], back[3], square;
    double rest = 0.0, more = 0.0, top = -INFINITY;
    long own, others = 1;
    while (meeting != other)
        if (meeting > other) meeting = bodies[meeting].parent;
        else other = bodies[other].parent;
    if (a->kind == '-' || (b->kind == '-') != (one->kind == HALF_SPACE))
        fail("%s and %s: a fact of another kind", a->name, b->name);
    for (int k = 0; k < 3; k++) {
        way[k] = exact(one->kind == PLANE ? one->way[k] : -b->T[k][2].m);
        back[k] = exact(-way[k].m);
    }
    square = dot(way, way);
    if (!(lo(square) > 0.0)) fail("a direction is 0");
    if (one->kind == PLANE) others = reach(b, meeting, back, heights[1], &more);
    else {
        ball at_plane[3] = {b->T[0][3], b->T[1][3], b->T[2][3]};
        heights[1][0] = above(hi(dot(at_plane, back)) + above(b->rounding * length(back)));
    }
    own = reach(a, meeting, way, heights[0], &rest);
    for (long i = 0; i < (own > others ? own : others); i++) {
        double sum = above(heights[0][own > 1 ? i : 0] + heights[1][others > 1 ? i : 0]);
        if (!isfinite(sum)) fail("numbers are too large");
        top = fmax(top, sum);
    }
    double loss = above(top + above(rest + more));
    /* The lower end of -loss / |u|: by the larger length where it is positive. */
    double scale = loss < 0.0 ? above(sqrt(hi(square))) : sqrt(lo(square)) * (1.0 - 0x1p-50);
    double least = -loss / scale;
    return least - fabs(least) * 0x1p-50 - TINY;
}

static const node *cells; /* begin and end of each */

static int by_cell(const void *x, const void *y) {
    long a = ((const fact *)x)->cell, b = ((const fact *)y)->cell;
    return (a > b) - (a < b);
}

static int by_pair(const void *x, const void *y) {
    const span *s = x, *t = y;
    if (s->a != t->a) return s->a < t->a ? -1 : 1;
    if (s->b != t->b) return s->b < t->b ? -1 : 1;
    return (s->begin > t->begin) - (s->begin < t->begin);
}

static long check_cover(const node *allowed, const fact *facts, long total) {
    span *spans = room((size_t)total, sizeof *spans);
    char *touch = room((size_t)(solid_count * solid_count), 1);
    long pairs = 0, next = 0;
    for (size_t k = 0; k < allowed->count; k++) {
        const node *one = allowed->items + k;
        long pair[2] = {-1, -1};
        if (one->kind != LIST || one->count < 2) fail("may_touch: no pair");
        for (int i = 0; i < 2; i++)
            for (long s = 0; s < solid_count; s++)
                if (one->items[i].kind == TEXT && !strcmp(solids[s].name, one->items[i].text))
                    pair[i] = solids[s].label;
        if (pair[0] >= 0 && pair[1] >= 0)
            touch[pair[0] * solid_count + pair[1]] = touch[pair[1] * solid_count + pair[0]] = 1;
    }
    for (long k = 0; k < total; k++) {
        const double *ends = cells->numbers + 2 * facts[k].cell;
        long a = facts[k].a, b = facts[k].b;
        spans[k] = (span){a < b ? a : b, a < b ? b : a, ends[0], ends[1]};
    }
    qsort(spans, (size_t)total, sizeof *spans, by_pair);
    for (long a = 0; a < solid_count; a++)
        for (long b = a + 1; b < solid_count; b++) {
            double reached = 0.0;
            for (; next < total && spans[next].a == a && spans[next].b == b; next++)
                if (spans[next].begin <= reached) reached = fmax(reached, spans[next].end);
            if (solids[a].body == solids[b].body) continue;
            if (touch[solids[a].label * solid_count + solids[b].label]) continue;
            if (!(reached >= knots[pieces]))
                fail("nothing parts %s and %s from %g s on", solids[a].name, solids[b].name, reached);
            pairs++;
        }
    return pairs;
}

static void add_fact(fact **last, const double *numbers, double cell, enum kind kind) {
    fact *one = (*last)++;
    one->a = (int)index_of(numbers[0], 0, solid_count, "solid");
    one->b = (int)index_of(numbers[1], 0, solid_count, "solid");
    one->cell = index_of(cell, 0, (long)(cells->count / 2), "cell");
    one->kind = kind;
    for (int i = 0; kind == PLANE && i < 3; i++) one->way[i] = numbers[3 + i];
}

/* Facts of both kinds, and of each pair and cell that the file leaves open. */
static fact *read_facts(const node *kinds, const node *open, fact **last) {
    size_t total = 0;
    for (size_t k = 0; k < kinds->count; k++) total += kinds->items[k].count;
    for (size_t k = 0; k < open->count; k++)
        if (find(open->items + k, "cells")) total += get(open->items + k, "cells", NUMBERS)->count;
    fact *facts = *last = room(total, sizeof *facts);
    for (size_t k = 0; k < kinds->count; k++) {
        enum kind kind = strcmp(kinds->items[k].key, "plane") ? HALF_SPACE : PLANE;
        if (kind != PLANE && strcmp(kinds->items[k].key, "half-space"))
            fail("facts %s are not known", kinds->items[k].key);
        const node *rows = table(kinds, kinds->items[k].key, 2, kind == PLANE ? 6 : 3, 0);
        for (size_t at = 0; at < rows->count; at += rows->sizes[1])
            add_fact(last, rows->numbers + at, rows->numbers[at + 2], kind);
    }
    for (size_t k = 0; k < open->count; k++) {
        if (strcmp(text(open->items + k, "what"), "pair")) continue;
        const node *own = table(open->items + k, "cells", 1, 0, 0);
        for (size_t c = 0; c < own->count; c++)
            add_fact(last, sequence(open->items + k, "pair", 2), own->numbers[c], LEFT_OPEN);
    }
    return facts;
}

static void check(const node *document) {
    if (strcmp(text(document, "format"), "armwright-witness") || number(document, "version") != 2.0)
        fail("this is no witness of version 2");
    read_bodies(get(document, "joints", LIST));
    read_solids(get(document, "solids", LIST));
    read_motion(document);
    check_joins(check_limits(get(document, "limits", OBJECT)) ? 3 : 2);
    check_end(document, "start", 0, exact(0.0));
    check_end(document, "goal", pieces - 1, piece_length(pieces - 1));
    cells = table(document, "cells", 2, 2, 0);
    const node *open = get(document, "unwitnessed", LIST);
    for (size_t k = 0; k < cells->count; k += 2) {
        const double *ends = cells->numbers + k;
        if (!(0.0 <= ends[0] && ends[0] < ends[1] && ends[1] <= knots[pieces]))
            fail("a cell is not within the motion");
    }
    fact *last, *facts = read_facts(get(document, "facts", OBJECT), open, &last);
    long total = last - facts, told = 0, entered = -1;
    long pairs = check_cover(get(document, "may_touch", LIST), facts, total);
    double clearance = INFINITY;
    most = room((size_t)body_count, sizeof *most), blur = room((size_t)body_count, sizeof *blur);
    frames = room((size_t)body_count, sizeof *frames);
    qsort(facts, (size_t)total, sizeof *facts, by_cell);
    for (long k = 0; k < total; k++) {
        const fact *one = facts + k;
        const double *ends = cells->numbers + 2 * one->cell;
        if (one->kind == LEFT_OPEN) continue;
        if (one->cell != entered) enter_cell(ends[0], ends[1]);
        entered = one->cell, told++;
        double least = gap(one), need = above(solids[one->a].margin + solids[one->b].margin);
        if (!(least > need))
            fail("cell %ld: %s and %s are not proved apart, gap %g m", entered, solids[one->a].name,
                 solids[one->b].name, least);
        clearance = fmin(clearance, least);
    }
    printf("accepted: %ld pairs apart by %g m at every instant, %ld facts in %zu cells; "
           "limits and joins hold\n", pairs, clearance, told, cells->count / 2);
    for (size_t k = 0; k < open->count; k++)
        printf("not witnessed: %s (%g)\n", text(open->items + k, "what"),
               number(open->items + k, "count"));
    exit(open->count ? 2 : 0);
}

int main(int words, char **arguments) {
    FILE *file = words != 2 ? NULL : strcmp(arguments[1], "-") ? fopen(arguments[1], "rb") : stdin;
    if (!file) {
        fprintf(stderr, "usage: armwright-check FILE\n");
        return 3;
    }
    size_t used = 0, block = 1 << 16;
    unsigned char *content = room(block, 1);
    for (size_t got; (got = fread(content + used, 1, block - used, file)) > 0;)
        if ((used += got) == block && !(content = realloc(content, block *= 2))) return 3;
    if (used < 4 || memcmp(content, "AWTN", 4)) fail("this is no witness in the compact form");
    at = content + 4, end = content + used;
    node document = {0};
    parse(&document, 0);
    if (at != end) fail("something stands behind the document");
    check(&document);
    return 0;
}
