/* Checker of witnesses: proves from one file that a robot's motion is free and within its limits.
 *
 * It shares no line with the program that wrote the file, nor with the checker in Python, and was
 * written from the page docs/witness.md of Armwright. Numbers are doubles with a bound of all that
 * was rounded off (struct ball); the bound of each operation is fixed beforehand from the unit of
 * rounding, so that no rounding mode is switched. Assumed are IEEE 754 doubles, sqrt and strtod
 * rounded correctly, sin and cos right to 4 units of rounding of 1.
 *
 *     cc -O2 -ffp-contract=off -o armwright-check armwright_check.c -lm
 *     armwright-check FILE
 *
 * Exit code: 0 all is proved, 2 all but what the file names as unwitnessed, 1 rejected, 3 no use.
 */

#include <math.h>
#include <stdarg.h>
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

typedef struct node node;
struct node {
    char kind; /* 'n' number, 's' string, 'a' array, 'o' object, '0' null, 'b' true or false */
    double number;
    const char *text, *key;
    node *first, *next;
    size_t count;
    node **items;
};

static const char *at;

static void blank(void) { while (*at && strchr(" \t\r\n", *at)) at++; }

static const char *string(void) {
    char *text, *end;
    const char *stop;
    if (*at != '"') fail("no string where one should be");
    for (stop = ++at; *stop != '"'; stop += *stop == '\\' ? 2 : 1)
        if (!*stop || (*stop == '\\' && !stop[1])) fail("a string has no end");
    end = text = room((size_t)(stop - at) + 1, 1);
    /* Names are only compared: escapes may stay as they are written, by one writer alike. */
    while (at < stop) *end++ = *at++;
    at++;
    return text;
}

static node *parse(int depth) {
    node *one = room(1, sizeof *one), **last = &one->first;
    blank();
    if (depth > MAX_DEPTH) fail("the file is nested too deep");
    if (*at == '{' || *at == '[') {
        char close = *at == '{' ? '}' : ']';
        one->kind = *at++ == '{' ? 'o' : 'a';
        for (blank(); *at != close; blank()) {
            const char *key = NULL;
            if (one->first && *at++ != ',') fail("a comma is missing");
            blank();
            if (one->kind == 'o') {
                key = string();
                blank();
                if (*at++ != ':') fail("a colon is missing");
            }
            *last = parse(depth + 1);
            (*last)->key = key;
            last = &(*last)->next;
            one->count++;
        }
        at++;
        one->items = room(one->count, sizeof *one->items);
        size_t k = 0;
        for (node *item = one->first; item; item = item->next) one->items[k++] = item;
    } else if (*at == '"') {
        one->kind = 's';
        one->text = string();
    } else if (!strncmp(at, "null", 4)) one->kind = '0', at += 4;
    else if (!strncmp(at, "true", 4)) one->kind = 'b', at += 4;
    else if (!strncmp(at, "false", 5)) one->kind = 'b', at += 5;
    else {
        char *end;
        if (*at != '-' && (*at < '0' || *at > '9')) fail("the file is malformed");
        one->kind = 'n';
        one->number = strtod(at, &end);
        if (end == at || !isfinite(one->number)) fail("a number is not finite");
        at = end;
    }
    return one;
}

static node *find(const node *object, const char *key) {
    node *found = NULL;
    if (object->kind != 'o') fail("there is no object with %s", key);
    for (node *item = object->first; item; item = item->next)
        if (!strcmp(item->key, key)) {
            if (found) fail("%s stands twice", key);
            found = item;
        }
    return found;
}

static node *get(const node *object, const char *key, char kind) {
    node *found = find(object, key);
    if (!found || (kind && found->kind != kind)) fail("field %s is missing or malformed", key);
    return found;
}

static double number(const node *one) {
    if (one->kind != 'n') fail("no number where one should be");
    return one->number;
}

static long index_of(const node *one, long first, long stop, const char *what) {
    double x = number(one);
    if (!(x >= first && x < stop) || x != floor(x)) fail("there is no %s %g", what, x);
    return (long)x;
}

static void list(const node *one, size_t count, const char *what) {
    if (one->kind != 'a' || one->count != count) fail("%s: not %zu items", what, count);
}

static const char *text(const node *object, const char *key) { return get(object, key, 's')->text; }

typedef struct { int turns, parent, leader; ball factor, offset, T[3][4]; } body;
typedef struct {
    const char *name;
    long label; /* number of the name */
    char kind;  /* first letter: hull, cylinder, cone ('o'), half-space ('-') */
    int body;
    size_t count;
    double (*vertices)[3], most[3], radius, half, rounding, margin, reach;
    ball T[3][4], center[3];
} solid;
typedef struct { long cell; int a, b, plane; double way[3]; } fact;
typedef struct { long a, b; double begin, end; } span;

static body *bodies;
static solid *solids;
static long n, body_count, solid_count, pieces, terms;
static double *knots;
static ball *coefficients; /* of piece i, joint j: terms numbers from (i n + j) terms on */

static const ball *polynomial(long i, long j) { return coefficients + (i * n + j) * terms; }

static void read_transform(const node *row, ball T[3][4]) {
    list(row, 12, "transform");
    for (int k = 0; k < 12; k++) T[k / 4][k % 4] = exact(number(row->items[k]));
}

static void read_bodies(const node *rows) {
    body_count = (long)rows->count;
    bodies = room(rows->count, sizeof *bodies);
    for (long k = 0; k < body_count; k++) n += !find(rows->items[k], "follows");
    if (!n) fail("there are no joints");
    for (long k = 0; k < body_count; k++) {
        const node *row = rows->items[k], *follows = find(row, "follows");
        const char *kind = text(row, "kind");
        body *one = bodies + k;
        one->turns = !strcmp(kind, "revolute");
        if (!one->turns && strcmp(kind, "prismatic")) fail("joint %ld is of no kind", k);
        one->parent = (int)index_of(get(row, "parent", 'n'), -1, k, "body before");
        one->leader = (int)k, one->factor = exact(1.0), one->offset = exact(0.0);
        if (follows) {
            list(follows, 3, "follows");
            one->leader = (int)index_of(follows->items[0], 0, n, "joint to follow");
            one->factor = exact(number(follows->items[1]));
            one->offset = exact(number(follows->items[2]));
        } else if (k >= n) fail("a joint of its own comes behind one that follows another");
        read_transform(get(row, "transform", 'a'), one->T);
        for (int a = 0; a < 3; a++)
            for (int b = 0; b < 3; b++) {
                ball sum = exact(a == b ? -1.0 : 0.0);
                for (int i = 0; i < 3; i++) sum = add(sum, mul(one->T[i][a], one->T[i][b]));
                if (!(size(sum) <= ORTHONORMAL)) fail("the frame of joint %ld is no rotation", k);
            }
    }
}

static void read_hull(solid *one, const node *rows, double middle[3]) {
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    one->count = rows->count;
    one->vertices = room(rows->count, sizeof *one->vertices);
    if (!one->count) fail("solid %s has no corners", one->name);
    for (size_t v = 0; v < one->count; v++) {
        list(rows->items[v], 3, "vertex");
        for (int k = 0; k < 3; k++) {
            double x = one->vertices[v][k] = number(rows->items[v]->items[k]);
            low[k] = fmin(low[k], x), high[k] = fmax(high[k], x);
            one->most[k] = fmax(one->most[k], fabs(x));
        }
    }
    for (int k = 0; k < 3; k++) middle[k] = 0.5 * (low[k] + high[k]);
    for (size_t v = 0; v < one->count; v++) {
        ball away[3];
        for (int k = 0; k < 3; k++) away[k] = sub(exact(one->vertices[v][k]), exact(middle[k]));
        one->reach = fmax(one->reach, length(away));
    }
}

static void read_solids(const node *rows) {
    solid_count = (long)rows->count;
    solids = room(rows->count, sizeof *solids);
    for (long k = 0; k < solid_count; k++) {
        const node *row = rows->items[k], *margin = find(row, "margin");
        solid *one = solids + k;
        const char *kind = text(row, "kind");
        double middle[3] = {0.0, 0.0, 0.0};
        one->name = text(row, "name");
        for (one->label = 0; strcmp(solids[one->label].name, one->name); one->label++) {}
        one->body = (int)index_of(get(row, "body", 'n'), -1, body_count, "body");
        read_transform(get(row, "transform", 'a'), one->T);
        one->rounding = number(get(row, "rounding", 'n'));
        one->margin = margin ? number(margin) : 0.0;
        if (!strcmp(kind, "hull")) {
            one->kind = 'h';
            read_hull(one, get(row, "vertices", 'a'), middle);
        } else if (!strcmp(kind, "half-space")) {
            one->kind = '-';
            if (one->body != -1) fail("half-space %s moves", one->name);
        } else {
            one->kind = !strcmp(kind, "cylinder") ? 'c' : 'o';
            if (one->kind == 'o' && strcmp(kind, "cone")) fail("solids %s are not known", kind);
            one->radius = number(get(row, "radius", 'n'));
            one->half = number(get(row, "half_height", 'n'));
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
    const node *times = get(document, "knots", 'a'), *rows = get(document, "polynomials", 'a');
    pieces = (long)rows->count;
    if (pieces < 1) fail("there are no polynomials");
    list(times, rows->count + 1, "knots");
    knots = room(times->count, sizeof *knots);
    for (long i = 0; i <= pieces; i++) {
        knots[i] = number(times->items[i]);
        if (i ? !(knots[i] > knots[i - 1]) : knots[0] != 0.0) fail("knots do not ascend from 0");
    }
    for (long i = 0; i < pieces; i++) {
        list(rows->items[i], (size_t)n, "piece");
        for (long j = 0; j < n; j++) {
            const node *row = rows->items[i]->items[j];
            if (!coefficients) {
                terms = (long)row->count;
                if (row->kind != 'a' || terms < 1 || terms > MAX_TERMS) fail("no polynomial");
                coefficients = room((size_t)(pieces * n * terms), sizeof *coefficients);
            }
            list(row, (size_t)terms, "polynomial");
            for (long k = 0; k < terms; k++)
                coefficients[(i * n + j) * terms + k] = exact(number(row->items[k]));
        }
    }
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
    double choose[MAX_TERMS][MAX_TERMS] = {{1.0}}; /* exact below 2^53 */
    memcpy(a, c, (size_t)count * sizeof *a);
    for (long first = 0; first + 1 < count; first++)
        for (long i = count - 2; i >= first; i--) a[i] = add(a[i], mul(s, a[i + 1]));
    for (long i = 0; i < count; i++) {
        a[i] = mul(a[i], scale), scale = mul(scale, h);
        for (long m = 0; m <= i; m++)
            choose[i][m] = !m || m == i ? 1.0 : choose[i - 1][m - 1] + choose[i - 1][m];
    }
    if (choose[count - 1][(count - 1) / 2] > 0x1p53) fail("polynomials have too many terms");
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
        const node *rows = get(limits, quantities[order], 'a');
        list(rows, (size_t)n, quantities[order]);
        for (long j = 0; j < n; j++) {
            const node *row = rows->items[j], *low = row, *high = row;
            if (!order) {
                list(row, 2, "limits of a position");
                low = row->items[0], high = row->items[1];
            }
            if (high->kind != '0') check_limit(order, j, 1.0, number(high));
            if (low->kind != '0') check_limit(order, j, -1.0, order ? number(low) : -number(low));
            smooth |= order == 3 && high->kind != '0';
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
    const node *row = get(document, name, 'a');
    list(row, (size_t)n, name);
    for (long j = 0; j < n; j++) {
        ball away = sub(value(polynomial(piece, j), terms, s), exact(number(row->items[j])));
        if (!(size(away) <= END)) fail("the motion misses its %s at joint %ld", name, j);
    }
}

static ball *steps;   /* of body k: count numbers from k count on */
static double *most;  /* the largest size of these */
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
        most[k] = 0.0;
        for (long i = first; i <= last; i++) {
            double low = fmax(begin, knots[i]), high = fmin(end, knots[i + 1]);
            ball *own = steps + k * count + (i - first) * terms;
            ball s = sub(exact(low), exact(knots[i])), h = sub(exact(high), exact(low));
            bernstein(polynomial(i, one->leader), terms, s, h, own);
            for (long m = 0; m < terms; m++) {
                own[m] = mul(one->factor, sub(own[m], q));
                most[k] = fmax(most[k], isnan(own[m].m) ? INFINITY : size(own[m]));
            }
        }
        place_body(k, add(mul(one->factor, q), one->offset));
    }
}

/* R'w */
static void carry(ball F[3][4], const ball *w, ball *turned) {
    for (int k = 0; k < 3; k++)
        turned[k] = add(add(mul(F[0][k], w[0]), mul(F[1][k], w[1])), mul(F[2][k], w[2]));
}

static ball shifted(ball F[3][4], const ball *w) {
    ball t[3] = {F[0][3], F[1][3], F[2][3]};
    return dot(t, w);
}

/* An upper bound of the core's support along a direction of its body's frame. */
static double support(const solid *one, const ball *w) {
    ball x[3], base = shifted((ball(*)[4])one->T, w);
    double best = -INFINITY, lost = 0.0;
    carry((ball(*)[4])one->T, w, x);
    if (one->kind == 'h') {
        double a = x[0].m, b = x[1].m, c = x[2].m;
        for (size_t v = 0; v < one->count; v++) {
            const double *p = one->vertices[v];
            double height = a * p[0] + b * p[1] + c * p[2];
            best = height > best ? height : best;
        }
        /* Three products and two sums: 5 units of the sum of sizes are more than they lose. */
        for (int k = 0; k < 3; k++) lost += one->most[k] * (x[k].r + 5.0 * U * fabs(x[k].m));
        return above(hi(base) + above(best + lost * UP + TINY));
    }
    double rim = above(one->radius * above(sqrt(hi(add(mul(x[0], x[0]), mul(x[1], x[1]))))));
    if (one->kind == 'c') return above(hi(base) + above(above(one->half * size(x[2])) + rim));
    double apex = hi(mul(exact(one->half), x[2])), foot = -lo(mul(exact(one->half), x[2]));
    return above(hi(base) + fmax(apex, above(rim + foot)));
}

/* Upper bounds whose means bound the solid along w to first order; how many, and of the rest. */
static long reach(const solid *one, int meeting, const ball *way, double *found, double *rest) {
    static int path[1 << 12];
    static ball tilts[1 << 12][3], offsets[1 << 12];
    ball center[3], w[3], base = exact(0.0);
    double far = 0.0, bound = 0.0;
    int joints = 0;
    memcpy(center, one->center, sizeof center);
    memcpy(w, way, sizeof w);
    for (int k = one->body; k != meeting; k = bodies[k].parent) {
        if (joints == 1 << 12) fail("there are too many joints");
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
        ball turned[3];
        for (int i = joints - 1; i > row; i--) {
            offsets[i] = add(offsets[i], shifted(frames[k], tilts[i]));
            carry(frames[k], tilts[i], turned);
            memcpy(tilts[i], turned, sizeof turned);
        }
        base = add(base, shifted(frames[k], w));
        carry(frames[k], w, turned);
        memcpy(w, turned, sizeof w);
        for (int i = 0; i < 3; i++) tilts[row][i] = exact(0.0);
        offsets[row] = exact(0.0);
        if (bodies[k].turns) tilts[row][0] = w[1], tilts[row][1] = (ball){-w[0].m, w[0].r};
        else offsets[row] = w[2];
    }
    double round = above(one->rounding * length(way));
    for (long i = 0; i < (joints ? count : 1); i++) {
        ball d[3] = {w[0], w[1], w[2]}, shift = base;
        for (int row = 0; row < joints; row++) {
            ball q = steps[path[row] * count + i];
            for (int k = 0; k < 3; k++) d[k] = add(d[k], mul(q, tilts[row][k]));
            shift = add(shift, mul(q, offsets[row]));
        }
        found[i] = above(above(support(one, d) + hi(shift)) + round);
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
    if (a->kind == '-' || (b->kind == '-') == one->plane)
        fail("%s and %s: a fact of another kind", a->name, b->name);
    for (int k = 0; k < 3; k++) {
        way[k] = exact(one->plane ? one->way[k] : -b->T[k][2].m);
        back[k] = exact(-way[k].m);
    }
    square = dot(way, way);
    if (!(lo(square) > 0.0)) fail("a direction is 0");
    if (one->plane) others = reach(b, meeting, back, heights[1], &more);
    else heights[1][0] = above(hi(shifted((ball(*)[4])b->T, back)) + above(b->rounding * length(back)));
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

static span spanned(const node *cells, long cell, long a, long b) {
    const node *row = cells->items[cell];
    return (span){a < b ? a : b, a < b ? b : a, row->items[0]->number, row->items[1]->number};
}

static long check_cover(const node *document, span *spans, long total) {
    const node *allowed = get(document, "may_touch", 'a');
    char *touch = room((size_t)(solid_count * solid_count), 1);
    long pairs = 0, next = 0;
    for (size_t k = 0; k < allowed->count; k++) {
        const node *row = allowed->items[k];
        long pair[2] = {-1, -1};
        list(row, 3, "may_touch");
        for (int i = 0; i < 2; i++)
            for (long s = 0; s < solid_count; s++)
                if (row->items[i]->kind == 's' && !strcmp(solids[s].name, row->items[i]->text))
                    pair[i] = solids[s].label;
        if (pair[0] >= 0 && pair[1] >= 0)
            touch[pair[0] * solid_count + pair[1]] = touch[pair[1] * solid_count + pair[0]] = 1;
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

static long read_facts(const node *document, const node *cells, fact **facts) {
    const node *kinds = get(document, "facts", 'o');
    long total = 0;
    for (int fill = 0; fill < 2; fill++) {
        if (fill) *facts = room((size_t)total, sizeof **facts);
        total = 0;
        for (const node *kind = kinds->first; kind; kind = kind->next) {
            int plane = !strcmp(kind->key, "plane");
            if (!plane && strcmp(kind->key, "half-space")) fail("facts %s are not known", kind->key);
            for (size_t g = 0; g < kind->count; g++) {
                const node *group = kind->items[g];
                list(group, 3, "facts of a pair");
                for (size_t k = 0; k < group->items[2]->count; k++, total++) {
                    const node *row = group->items[2]->items[k];
                    if (!fill) continue;
                    fact *one = *facts + total;
                    one->a = (int)index_of(group->items[0], 0, solid_count, "solid");
                    one->b = (int)index_of(group->items[1], 0, solid_count, "solid");
                    one->plane = plane;
                    if (plane) list(row, 4, "fact");
                    one->cell = index_of(plane ? row->items[0] : row, 0, (long)cells->count, "cell");
                    for (int i = 0; plane && i < 3; i++) one->way[i] = number(row->items[i + 1]);
                }
            }
        }
    }
    return total;
}

static void check(const node *document) {
    if (strcmp(text(document, "format"), "armwright-witness") ||
        number(get(document, "version", 'n')) != 1.0)
        fail("this is no witness of version 1");
    read_bodies(get(document, "joints", 'a'));
    read_solids(get(document, "solids", 'a'));
    read_motion(document);
    int smooth = check_limits(get(document, "limits", 'o'));
    check_joins(smooth ? 3 : 2);
    check_end(document, "start", 0, exact(0.0));
    check_end(document, "goal", pieces - 1, piece_length(pieces - 1));
    const node *cells = get(document, "cells", 'a'), *open = get(document, "unwitnessed", 'a');
    for (size_t k = 0; k < cells->count; k++) {
        list(cells->items[k], 2, "cell");
        double begin = number(cells->items[k]->items[0]), end = number(cells->items[k]->items[1]);
        if (!(0.0 <= begin && begin < end && end <= knots[pieces])) fail("a cell is not within the motion");
    }
    fact *facts = NULL;
    long total = read_facts(document, cells, &facts), told = 0;
    for (size_t k = 0; k < open->count; k++)
        if (!strcmp(text(open->items[k], "what"), "pair"))
            told += (long)get(open->items[k], "cells", 'a')->count;
    span *spans = room((size_t)(total + told), sizeof *spans), *last = spans;
    for (long k = 0; k < total; k++) *last++ = spanned(cells, facts[k].cell, facts[k].a, facts[k].b);
    for (size_t k = 0; k < open->count; k++) {
        if (strcmp(text(open->items[k], "what"), "pair")) continue;
        const node *pair = get(open->items[k], "pair", 'a'), *own = get(open->items[k], "cells", 'a');
        list(pair, 2, "pair");
        for (size_t c = 0; c < own->count; c++)
            *last++ = spanned(cells, index_of(own->items[c], 0, (long)cells->count, "cell"),
                              index_of(pair->items[0], 0, solid_count, "solid"),
                              index_of(pair->items[1], 0, solid_count, "solid"));
    }
    long pairs = check_cover(document, spans, total + told), entered = -1;
    double clearance = INFINITY;
    most = room((size_t)body_count, sizeof *most);
    frames = room((size_t)body_count, sizeof *frames);
    qsort(facts, (size_t)total, sizeof *facts, by_cell);
    for (long k = 0; k < total; k++) {
        const fact *one = facts + k;
        const node *cell = cells->items[one->cell];
        if (one->cell != entered) enter_cell(cell->items[0]->number, cell->items[1]->number);
        entered = one->cell;
        double least = gap(one), need = above(solids[one->a].margin + solids[one->b].margin);
        if (!(least > need))
            fail("cell %ld: %s and %s are not proved apart, gap %g m", entered, solids[one->a].name,
                 solids[one->b].name, least);
        clearance = fmin(clearance, least);
    }
    printf("accepted: %ld pairs apart by %g m at every instant, %ld facts in %zu cells; "
           "limits and joins hold\n", pairs, clearance, total, cells->count);
    for (size_t k = 0; k < open->count; k++)
        printf("not witnessed: %s (%g)\n", text(open->items[k], "what"),
               number(get(open->items[k], "count", 'n')));
    exit(open->count ? 2 : 0);
}

int main(int words, char **arguments) {
    FILE *file = words == 2 ? fopen(arguments[1], "rb") : NULL;
    if (!file) {
        fprintf(stderr, "usage: armwright-check FILE\n");
        return 3;
    }
    size_t used = 0, block = 1 << 16;
    char *content = room(block + 1, 1);
    for (size_t got; (got = fread(content + used, 1, block - used, file)) > 0;)
        if ((used += got) == block && !(content = realloc(content, (block *= 2) + 1))) return 3;
    content[used] = 0;
    at = content;
    node *document = parse(0);
    blank();
    if (*at) fail("something stands behind the document");
    check(document);
    return 0;
}
