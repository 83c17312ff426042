/* Volumetric compensation of LinuxCNC: a lattice of corrections over all axes, between motion controller and drives.
 *
 *   loadrt errormodel_3d file=$(CONFIG_DIR)/errormodel_3d.table axes=XYZAC moves=XYZ
 *   addf errormodel-3d servo-thread            (after motion-controller, before the drives)
 *
 * In every servo cycle the corrections of the axes named by `moves` are interpolated (multilinear; beyond the lattice
 * its edge holds) at the positions of the axes named by `axes`, and added to what goes to the motors; what comes back
 * from them is returned without it, so that the motion controller sees its own commands. Positions in machine units
 * (mm) and degrees.
 *
 * The correction acts while the table is valid, `enable` is on and every axis is homed. It is ramped on and off over
 * `ramp-time` seconds, never exceeds `limit`, and never changes faster than `rate`. `inhibit` is on where the table is
 * missing or damaged and while the correction is being ramped on: it belongs to motion.feed-inhibit.
 *
 * Where the table has them, corrections follow the length of the tool: per mm by which `tool-length` exceeds
 * `tool-reference`, if `tool-follow` is on.
 *
 * Apache-2.0. Part of errormodel.
 */

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "rtapi.h"
#include "rtapi_app.h"
#include "rtapi_math.h"
#include "hal.h"

MODULE_AUTHOR("errormodel");
MODULE_DESCRIPTION("Volumetric compensation from a lattice of corrections");
MODULE_LICENSE("Apache-2.0");

#define NAME "errormodel_3d"
#define PREFIX "errormodel-3d"
#define VERSION 1
#define MOST_AXES 9
#define MOST_BYTES (256L << 20)
#define FULL_TURN 360.0
#define OUTSIDE 1e-6 /* mm or deg beyond the lattice that count as outside */

static char *file = "errormodel_3d.table";
RTAPI_MP_STRING(file, "table that errormodel wrote");
static char *axes = "XYZ";
RTAPI_MP_STRING(axes, "letters of the axes of the lattice, in its order");
static char *moves = "XYZ";
RTAPI_MP_STRING(moves, "letters of the axes that are corrected");

typedef struct {
    hal_bit_t *enable, *valid, *active, *inhibit, *outside, *limited, *lagging, *tool_follow;
    hal_float_t *share, *tool_length, *tool_reference;
    hal_float_t limit, rate, ramp_time;
    hal_float_t *position[MOST_AXES];
    hal_bit_t *homed[MOST_AXES];
    hal_float_t *motor_in[MOST_AXES], *motor_out[MOST_AXES];
    hal_float_t *feedback_in[MOST_AXES], *feedback_out[MOST_AXES], *correction[MOST_AXES];
} pins_t;

typedef struct {
    int points, turns; /* nodes along the axis; whether it goes round */
    long stride;       /* nodes from one position along it to the next */
    double *grid;
} side_t;

static int component, count, outputs, columns; /* columns: values of a node, twice the outputs if it has the tool's */
static side_t side[MOST_AXES];
static double *values; /* nodes x columns, the last axis fastest */
static pins_t *pins;
static double applied[MOST_AXES];

/* ---- the table ------------------------------------------------------------------------------------------------ */

static unsigned long crc32_of(const char *text, long length)
{
    unsigned long crc = 0xFFFFFFFFUL;
    for (long k = 0; k < length; k++) {
        crc ^= (unsigned char)text[k];
        for (int bit = 0; bit < 8; bit++) crc = (crc >> 1) ^ ((crc & 1) ? 0xEDB88320UL : 0);
    }
    return crc ^ 0xFFFFFFFFUL;
}

/* The whole file as a string, or NULL with the reason. */
static char *text_of(const char *path, const char **why)
{
    FILE *in = fopen(path, "rb");
    char *text = NULL;
    long length;
    *why = "it cannot be opened";
    if (!in) return NULL;
    *why = "it cannot be read";
    if (!fseek(in, 0, SEEK_END) && (length = ftell(in)) > 0 && length < MOST_BYTES && !fseek(in, 0, SEEK_SET)
        && (text = malloc(length + 1))) {
        if (fread(text, 1, length, in) == (size_t)length) text[length] = 0;
        else { free(text); text = NULL; }
    }
    fclose(in);
    return text;
}

static char *next;

static char *word(void)
{
    char *start = next + strspn(next, " \t\r\n");
    next = start + strcspn(start, " \t\r\n");
    if (*next) *next++ = 0;
    return start;
}

static int number(double *value)
{
    char *start = word(), *end;
    *value = strtod(start, &end);
    return *start && !*end && isfinite(*value);
}

static int whole(long *value, long least, long most)
{
    double found;
    if (!number(&found) || found < least || found > most || found != floor(found)) return 0;
    *value = (long)found;
    return 1;
}

/* Reads the words after the comments; returns the reason why the table cannot be used, or NULL. */
static const char *understood(void)
{
    long nodes = 1, size, version, tool;
    char *turns;
    if (strcmp(word(), "errormodel-3d") || !whole(&version, VERSION, VERSION)) return "its first line is not of this version";
    if (strcmp(word(), "axes") || strcmp(word(), axes)) return "its axes are not those of axes=";
    if (strcmp(word(), "moves") || strcmp(word(), moves)) return "its corrected axes are not those of moves=";
    if (strcmp(word(), "turns")) return "'turns' is missing";
    turns = word();
    if (strcmp(word(), "tool") || !whole(&tool, 0, 1)) return "'tool' is missing";
    columns = outputs * (1 + (int)tool);
    for (int k = 0; k < count; k++) {
        char letter[2] = {axes[k], 0};
        if (strcmp(word(), "grid") || strcmp(word(), letter) || !whole(&size, 1, 1000000)) return "a grid is missing";
        side[k].points = (int)size;
        side[k].turns = strchr(turns, axes[k]) != NULL;
        if (!(side[k].grid = malloc(size * sizeof(double)))) return "there is no memory for it";
        for (int i = 0; i < size; i++)
            if (!number(&side[k].grid[i]) || (i && side[k].grid[i] <= side[k].grid[i - 1])) return "a grid does not increase";
        nodes *= size;
        if (nodes > MOST_BYTES) return "it is too large";
    }
    for (long k = count - 1, stride = 1; k >= 0; stride *= side[k--].points) side[k].stride = stride;
    if (strcmp(word(), "values") || !whole(&size, nodes, nodes)) return "it has not as many values as nodes";
    if (!(values = malloc(nodes * columns * sizeof(double)))) return "there is no memory for it";
    for (long k = 0; k < nodes * columns; k++)
        if (!number(&values[k])) return "a value is no number";
    return strcmp(word(), "check") ? "there are more values than nodes" : NULL;
}

static const char *read_table(void)
{
    const char *why;
    char *text = text_of(file, &why), *start = text, *check = NULL;
    if (!text) return why;
    while (*start == '#') {
        start += strcspn(start, "\n");
        start += *start != 0;
    }
    for (next = start; (next = strstr(next, "\ncheck ")); next++) check = next;
    why = "its end is missing";
    if (check) {
        why = "it is damaged: its check sum is another";
        if (strtoul(check + 7, NULL, 16) == crc32_of(start, check + 1 - start)) {
            next = start;
            why = understood();
        }
    }
    free(text);
    return why;
}

/* ---- one servo cycle ------------------------------------------------------------------------------------------ */

/* Corrections at the axes' positions for a tool longer by `longer`; whether a position lies outside the lattice. */
static int lookup(double longer, double *out)
{
    static long corner[1 << MOST_AXES]; /* one thread calls this; a stack of a real-time thread is small */
    static double weight[1 << MOST_AXES];
    int corners = 1, beyond = 0;
    corner[0] = 0;
    weight[0] = 1.0;
    for (int k = 0; k < count; k++) {
        const double *g = side[k].grid;
        int low = 0, high = side[k].points - 1;
        double p = *pins->position[k], part = 0.0;
        if (side[k].turns) p -= FULL_TURN * floor((p - g[0]) / FULL_TURN);
        if (p < g[0] - OUTSIDE || p > g[high] + OUTSIDE) beyond = 1;
        if (p >= g[high]) low = high;
        else if (p > g[0]) {
            while (high - low > 1) {
                int middle = (low + high) / 2;
                if (g[middle] <= p) low = middle; else high = middle;
            }
            part = (p - g[low]) / (g[low + 1] - g[low]);
        }
        for (int i = 0; i < corners; i++) corner[i] += low * side[k].stride;
        if (part > 0.0) {
            for (int i = 0; i < corners; i++) {
                corner[corners + i] = corner[i] + side[k].stride;
                weight[corners + i] = weight[i] * part;
                weight[i] *= 1.0 - part;
            }
            corners *= 2;
        }
    }
    for (int o = 0; o < outputs; o++) out[o] = 0.0;
    for (int i = 0; i < corners; i++) {
        const double *node = values + corner[i] * columns;
        for (int o = 0; o < outputs; o++)
            out[o] += weight[i] * (node[o] + (columns > outputs ? longer * node[outputs + o] : 0.0));
    }
    return beyond;
}

static void update(void *arg, long period)
{
    double seconds = period * 1e-9, wanted[MOST_AXES] = {0.0};
    double longer = *pins->tool_follow ? *pins->tool_length - *pins->tool_reference : 0.0;
    int finite = isfinite(longer), on = *pins->valid && *pins->enable, limited = 0, lagging = 0;
    for (int k = 0; k < count; k++) {
        finite = finite && isfinite(*pins->position[k]);
        on = on && *pins->homed[k];
    }
    on = on && finite;
    *pins->outside = *pins->valid && finite && (on || *pins->share > 0.0) && lookup(longer, wanted);
    double step = pins->ramp_time > seconds ? seconds / pins->ramp_time : 1.0;
    *pins->share = on ? fmin(*pins->share + step, 1.0) : fmax(*pins->share - step, 0.0);
    for (int o = 0; o < outputs; o++) {
        double most = fabs(pins->limit), change = fabs(pins->rate) * seconds, next_one = wanted[o];
        if (fabs(next_one) > most) { next_one = next_one > 0 ? most : -most; limited = 1; }
        next_one = *pins->share * next_one - applied[o];
        if (fabs(next_one) > change) { next_one = next_one > 0 ? change : -change; lagging = 1; }
        applied[o] += next_one;
        *pins->correction[o] = applied[o];
        *pins->motor_out[o] = *pins->motor_in[o] + applied[o];
        *pins->feedback_out[o] = *pins->feedback_in[o] - applied[o];
    }
    *pins->limited = limited;
    *pins->lagging = lagging;
    *pins->active = on && *pins->share >= 1.0 && !lagging;
    *pins->inhibit = !*pins->valid || (on && *pins->share < 1.0);
}

/* ---- pins ----------------------------------------------------------------------------------------------------- */

static int new_pins(void)
{
    int bad = 0;
    bad |= hal_pin_bit_newf(HAL_IN, &pins->enable, component, PREFIX ".enable");
    bad |= hal_pin_bit_newf(HAL_IN, &pins->tool_follow, component, PREFIX ".tool-follow");
    bad |= hal_pin_float_newf(HAL_IN, &pins->tool_length, component, PREFIX ".tool-length");
    bad |= hal_pin_float_newf(HAL_IN, &pins->tool_reference, component, PREFIX ".tool-reference");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->valid, component, PREFIX ".valid");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->active, component, PREFIX ".active");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->inhibit, component, PREFIX ".inhibit");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->outside, component, PREFIX ".outside");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->limited, component, PREFIX ".limited");
    bad |= hal_pin_bit_newf(HAL_OUT, &pins->lagging, component, PREFIX ".lagging");
    bad |= hal_pin_float_newf(HAL_OUT, &pins->share, component, PREFIX ".share");
    bad |= hal_param_float_newf(HAL_RW, &pins->limit, component, PREFIX ".limit");
    bad |= hal_param_float_newf(HAL_RW, &pins->rate, component, PREFIX ".rate");
    bad |= hal_param_float_newf(HAL_RW, &pins->ramp_time, component, PREFIX ".ramp-time");
    for (int k = 0; k < count; k++) {
        bad |= hal_pin_float_newf(HAL_IN, &pins->position[k], component, PREFIX ".%c.position", axes[k]);
        bad |= hal_pin_bit_newf(HAL_IN, &pins->homed[k], component, PREFIX ".%c.homed", axes[k]);
    }
    for (int o = 0; o < outputs; o++) {
        bad |= hal_pin_float_newf(HAL_IN, &pins->motor_in[o], component, PREFIX ".%c.motor-in", moves[o]);
        bad |= hal_pin_float_newf(HAL_OUT, &pins->motor_out[o], component, PREFIX ".%c.motor-out", moves[o]);
        bad |= hal_pin_float_newf(HAL_IN, &pins->feedback_in[o], component, PREFIX ".%c.feedback-in", moves[o]);
        bad |= hal_pin_float_newf(HAL_OUT, &pins->feedback_out[o], component, PREFIX ".%c.feedback-out", moves[o]);
        bad |= hal_pin_float_newf(HAL_OUT, &pins->correction[o], component, PREFIX ".%c.correction", moves[o]);
    }
    pins->limit = 1.0;
    pins->rate = 5.0;
    pins->ramp_time = 1.0;
    return bad;
}

int rtapi_app_main(void)
{
    const char *why;
    count = (int)strlen(axes);
    outputs = (int)strlen(moves);
    if (count < 1 || count > MOST_AXES || outputs < 1 || outputs > MOST_AXES) {
        rtapi_print_msg(RTAPI_MSG_ERR, NAME ": axes= and moves= take 1 to %d letters\n", MOST_AXES);
        return -1;
    }
    if ((component = hal_init(NAME)) < 0) return component;
    why = read_table();
    if (why) rtapi_print_msg(RTAPI_MSG_ERR, NAME ": NOTHING IS CORRECTED: %s: %s\n", file, why);
    pins = hal_malloc(sizeof(pins_t));
    if (!pins || (memset(pins, 0, sizeof(pins_t)), new_pins())
        || hal_export_funct(PREFIX, update, NULL, 1, 0, component)) {
        hal_exit(component);
        return -1;
    }
    *pins->valid = !why;
    *pins->inhibit = !!why;
    hal_ready(component);
    return 0;
}

void rtapi_app_exit(void)
{
    hal_exit(component);
    for (int k = 0; k < count; k++) free(side[k].grid);
    free(values);
}
