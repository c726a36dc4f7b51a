/* A flexible leg as a model for co-simulation of FMI 3.0.
 *
 * The leg itself is compiled code, see `leg_move` below. This file holds its memory, lets a program
 * set parameters and input, computes the rest pose in which a simulation begins, and takes the
 * steps between two communication points.
 *
 * leg.h is written for each leg: its numbers (LEG_NUMBERS), where each of them lies (AT_...), its
 * variables and their value references (VARIABLE_...). Names as in rfca_rig/model/kernel/state.py.
 */
#include <cpuid.h>
#include <math.h>
#include <stdarg.h>
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef FMI3_HEADER
#include FMI3_HEADER
#else
#include "fmi3.h"
#endif
#include "leg.h"

#ifdef _WIN32
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

/* Status of leg_move: `integrator.DONE` and its neighbours. */
enum { MOVE_DONE = 0, MOVE_STEP_TOO_SHORT = 1, MOVE_TOO_MANY_STEPS = 2 };

/* The step with which an integration begins [s], as `integrator.FIRST_STEP_S`. */
static const double FIRST_STEP_S = 1e-4;
/* Error per step in angles [rad] where a program states none, and the factor from there to the
 * error in speeds [1/s]: those of `chain.Tolerance`. */
static const double DEFAULT_TOLERANCE_RAD = 1e-5;
static const double SPEED_TOLERANCE_PER_S = 3e3;
/* A communication point may be off by this share of the step, since programs round their times. */
static const double TIME_TOLERANCE = 1e-3;

/* The compiled leg. It reads and changes both blocks and nothing else. */
int64_t leg_settle(double *numbers, int64_t *integers);
int64_t leg_measure(double *numbers, int64_t *integers);
int64_t leg_move(double *numbers, int64_t *integers);

typedef enum { INSTANTIATED, INITIALIZATION_MODE, STEP_MODE, TERMINATED, FAILED } Mode;

/* Everything that changes, without any pointer: a copy of it is the whole state of a model. */
typedef struct {
    Mode mode;
    bool settled; /* whether `numbers` hold the rest pose of the present parameters */
    double time;
    double input;
    double command_rad; /* where the command of the shaft stands, and how fast it turns */
    double command_rad_s;
    double command_rad_s2; /* during the last step */
    double parameters[PARAMETERS];
    double numbers[NUMBERS];
} Model;

typedef struct {
    Model model;
    /* Not part of a saved state: the addresses of the laws hold for this process alone. */
    int64_t integers[INTEGERS];
    fmi3InstanceEnvironment environment;
    fmi3LogMessageCallback log_message;
} Instance;

/* Whether processor and system have the instructions for which the leg is compiled (x86-64-v3).
 * Without them it would end the whole program. */
static bool has_instructions(void)
{
    const unsigned base = bit_FMA | bit_MOVBE | bit_OSXSAVE | bit_AVX | bit_F16C;
    const unsigned extended = bit_AVX2 | bit_BMI | bit_BMI2;
    const unsigned saved = 6; /* the system keeps the registers of SSE and AVX */
    unsigned a, b, c, d;

    if (!__get_cpuid(1, &a, &b, &c, &d) || (c & base) != base) {
        return false;
    }
    if (!__get_cpuid_count(7, 0, &a, &b, &c, &d) || (b & extended) != extended) {
        return false;
    }
    __asm__ volatile("xgetbv" : "=a"(a), "=d"(d) : "c"(0));
    return (a & saved) == saved;
}

/* Reports an error to the program, and returns it. */
static fmi3Status fail(const Instance *instance, const char *format, ...)
{
    char message[256];
    va_list arguments;

    va_start(arguments, format);
    vsnprintf(message, sizeof message, format, arguments);
    va_end(arguments);
    if (instance->log_message != NULL) {
        instance->log_message(instance->environment, fmi3Error, "logStatusError", message);
    }
    return fmi3Error;
}

/* The same, for a model that cannot go on. */
static fmi3Status give_up(Instance *instance, const char *message)
{
    instance->model.mode = FAILED;
    return fail(instance, "%s, at %g s", message, instance->model.time);
}

static void reset(Instance *instance)
{
    Model *model = &instance->model;

    memset(model, 0, sizeof *model);
    memcpy(model->numbers, LEG_NUMBERS, sizeof model->numbers);
    for (int i = 0; i < PARAMETERS; i++) {
        model->parameters[i] = LEG_PARAMETERS[i].start;
    }
    model->numbers[AT_TOLERANCE] = DEFAULT_TOLERANCE_RAD;
    model->numbers[AT_TOLERANCE + 1] = DEFAULT_TOLERANCE_RAD * SPEED_TOLERANCE_PER_S;
    model->mode = INSTANTIATED;
}

/* Writes the parameters to the numbers that follow from them. */
static void apply_parameters(Model *model)
{
    for (int i = 0; i < USES; i++) {
        const Use *use = &LEG_USES[i];
        double value = model->parameters[use->parameter];

        /* At its start value a number keeps the last digit that it has in the template. */
        if (value == LEG_PARAMETERS[use->parameter].start) {
            model->numbers[use->at] = LEG_NUMBERS[use->at];
        } else {
            model->numbers[use->at] = use->intercept + use->slope * value;
        }
    }
}

/* Puts the leg at rest with its shaft at the start angle, under its weight. */
static fmi3Status settle(Instance *instance)
{
    Model *model = &instance->model;
    double *numbers = model->numbers;
    double start_rad = START_ANGLE_RAD(model->parameters);
    double shape_rad = start_rad;
    int64_t found;

    apply_parameters(model);
    /* The weight has taken up the play of a drive that sags. */
    if (DRIVE_SAGS) {
        shape_rad += numbers[AT_SHAFT_GAP];
    }
    for (int i = 0; i < COORDINATES; i++) {
        if (i < LINKS) {
            shape_rad += numbers[AT_REST + i];
            numbers[AT_Q + i] = shape_rad;
        } else {
            numbers[AT_Q + i] = 0.0; /* a frame counts from where it carries the leg */
        }
        numbers[AT_W + i] = 0.0;
        numbers[AT_A + i] = 0.0;
    }
    memset(numbers + AT_ANCHOR, 0, LINKS * sizeof(double));
    memset(numbers + AT_MEMORY, 0, MEMORY * sizeof(double));
    numbers[AT_SHAFT_ANGLE] = start_rad;
    numbers[AT_SHAFT_FEED] = 0.0;

    /* Friction would make the pose depend on how the leg got there. A shaft is held, unless the
     * spring of its drive carries the weight. */
    double mu = numbers[AT_MU];
    double drag = numbers[AT_DRAG];
    double shaft_free = numbers[AT_SHAFT_FREE];
    numbers[AT_MU] = 0.0;
    numbers[AT_DRAG] = 0.0;
    numbers[AT_SHAFT_FREE] = DRIVE_SAGS;
    found = leg_settle(numbers, instance->integers);
    numbers[AT_MU] = mu;
    numbers[AT_DRAG] = drag;
    numbers[AT_SHAFT_FREE] = shaft_free;
    if (found != 1) {
        return give_up(instance, "no rest pose found; are the parameters right?");
    }
    if (leg_measure(numbers, instance->integers) != 1) {
        return give_up(instance, "the forces at rest cannot be computed");
    }
    /* The integrator of a drive has taken up the weight before the motion, and keeps its torque. */
    if (DRIVE_HOLDS) {
        numbers[AT_SHAFT_FEED] = numbers[AT_FORCE + 2];
    }
    model->command_rad = start_rad;
    model->command_rad_s = 0.0;
    model->command_rad_s2 = 0.0;
    numbers[AT_NEXT_STEP] = FIRST_STEP_S;
    model->settled = true;
    return fmi3OK;
}

/* Moves the leg on by a step of length `step` [s]. */
static fmi3Status move(Instance *instance, double step)
{
    Model *model = &instance->model;
    double *numbers = model->numbers;
    double acceleration = 0.0;

    if (INPUT_IS_TORQUE) {
        numbers[AT_SHAFT_FEED] = model->input;
    } else {
        /* The command reaches the speed of the input at the end of the step. */
        acceleration = (model->input - model->command_rad_s) / step;
    }
    /* Times count from the begin of the step, so that they have all digits in a long simulation. */
    numbers[AT_BREAKS] = 0.0;
    numbers[AT_BREAKS + 1] = step;
    numbers[AT_COEFFICIENT] = model->command_rad;
    numbers[AT_COEFFICIENT + 1] = model->command_rad_s;
    numbers[AT_COEFFICIENT + 2] = 0.5 * acceleration;
    numbers[AT_COEFFICIENT + 3] = 0.0;
    /* Where the acceleration jumps, the integration begins with a short step. */
    numbers[AT_LANDINGS] = acceleration == model->command_rad_s2 ? INFINITY : 0.0;
    numbers[AT_SPAN] = 0.0;
    numbers[AT_SPAN + 1] = step;
    numbers[AT_SAMPLE_TIME] = step;
    memset(numbers + AT_ENDS, 0, ENDS * sizeof(double));

    switch (leg_move(numbers, instance->integers)) {
    case MOVE_DONE:
        break;
    case MOVE_STEP_TOO_SHORT:
        return give_up(instance, "no step above 1e-10 s converges; are the parameters right?");
    default:
        return give_up(instance, "too many steps; are the parameters right?");
    }
    model->command_rad += step * (model->command_rad_s + 0.5 * step * acceleration);
    model->command_rad_s += step * acceleration;
    model->command_rad_s2 = acceleration;
    return fmi3OK;
}

static double add_up(const double *values, int count)
{
    double sum = 0.0;

    for (int i = 0; i < count; i++) {
        sum += values[i];
    }
    return sum;
}

/* The value of an output. */
static double read_output(const Model *model, fmi3ValueReference reference)
{
    const double *numbers = model->numbers;
    const double *force = numbers + AT_FORCE;

    switch (reference) {
    case VARIABLE_SHAFT:
        return numbers[AT_Q];
    case VARIABLE_SHAFT_SPEED:
        return numbers[AT_W];
    case VARIABLE_SHAFT_TORQUE:
        return force[2];
    case VARIABLE_FY:
        return force[0];
    case VARIABLE_FZ:
        return force[1];
    case VARIABLE_TX:
        return force[2] + BELOW_SHAFT_M * force[0];
    case VARIABLE_NORMAL:
        return add_up(numbers + AT_CONTACT, LINKS);
    case VARIABLE_TANGENTIAL:
        return add_up(numbers + AT_CONTACT + LINKS, LINKS);
    default: {
        int hinge = (int)(reference - VARIABLE_HINGES);

        return numbers[AT_Q + hinge + 1] - numbers[AT_Q + hinge];
    }
    }
}

/* --- Life of an instance ------------------------------------------------------------------- */

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance instance, fmi3Boolean logging_on,
                                      size_t categories, const fmi3String names[])
{
    (void)instance;
    (void)logging_on;
    (void)categories;
    (void)names;
    return fmi3OK; /* there are only errors to report */
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging_on, fmi3Boolean event_mode_used, fmi3Boolean early_return_allowed,
    const fmi3ValueReference intermediate[], size_t intermediates,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
    fmi3IntermediateUpdateCallback intermediate_update)
{
    Instance *instance = calloc(1, sizeof *instance);

    (void)name;
    (void)resources;
    (void)visible;
    (void)logging_on;
    (void)event_mode_used;
    (void)early_return_allowed;
    (void)intermediate;
    (void)intermediates;
    (void)intermediate_update;
    if (instance == NULL) {
        return NULL;
    }
    instance->environment = environment;
    instance->log_message = log_message;
    if (token == NULL || strcmp(token, INSTANTIATION_TOKEN) != 0) {
        fail(instance, "modelDescription.xml and the binary are of two different exports");
        free(instance);
        return NULL;
    }
    if (!has_instructions()) {
        fail(instance, "the processor lacks AVX2 or FMA; it must be of the level x86-64-v3");
        free(instance);
        return NULL;
    }
    leg_fill_integers(instance->integers);
    reset(instance);
    return instance;
}

EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging_on, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging_on;
    (void)environment;
    (void)log_message;
    return NULL; /* for co-simulation only */
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible,
    fmi3Boolean logging_on, fmi3InstanceEnvironment environment, fmi3LogMessageCallback log_message,
    fmi3ClockUpdateCallback clock_update, fmi3LockPreemptionCallback lock_preemption,
    fmi3UnlockPreemptionCallback unlock_preemption)
{
    (void)name;
    (void)token;
    (void)resources;
    (void)visible;
    (void)logging_on;
    (void)environment;
    (void)log_message;
    (void)clock_update;
    (void)lock_preemption;
    (void)unlock_preemption;
    return NULL; /* for co-simulation only */
}

EXPORT void fmi3FreeInstance(fmi3Instance instance)
{
    free(instance);
}

EXPORT fmi3Status fmi3EnterInitializationMode(fmi3Instance instance, fmi3Boolean tolerance_defined,
                                              fmi3Float64 tolerance, fmi3Float64 start_time,
                                              fmi3Boolean stop_time_defined, fmi3Float64 stop_time)
{
    Instance *self = instance;
    Model *model = &self->model;

    (void)stop_time_defined;
    (void)stop_time;
    if (model->mode != INSTANTIATED) {
        return fail(self, "initialization follows instantiation or a reset");
    }
    if (tolerance_defined) {
        if (!(tolerance > 0.0)) {
            return fail(self, "the tolerance is %g; it must be above 0", tolerance);
        }
        model->numbers[AT_TOLERANCE] = tolerance;
        model->numbers[AT_TOLERANCE + 1] = tolerance * SPEED_TOLERANCE_PER_S;
    }
    model->time = start_time;
    model->mode = INITIALIZATION_MODE;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance instance)
{
    Instance *self = instance;

    if (self->model.mode != INITIALIZATION_MODE) {
        return fail(self, "there is no initialization to end");
    }
    if (!self->model.settled && settle(self) != fmi3OK) {
        return fmi3Error;
    }
    self->model.mode = STEP_MODE;
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(fmi3Instance instance, fmi3Float64 point, fmi3Float64 step,
                             fmi3Boolean no_set_state_before, fmi3Boolean *event_handling_needed,
                             fmi3Boolean *terminate_simulation, fmi3Boolean *early_return,
                             fmi3Float64 *last_successful_time)
{
    Instance *self = instance;
    Model *model = &self->model;
    fmi3Status status;

    (void)no_set_state_before;
    *event_handling_needed = false;
    *terminate_simulation = false;
    *early_return = false;
    *last_successful_time = model->time;
    if (model->mode != STEP_MODE) {
        return fail(self, "a step follows the initialization");
    }
    if (!(step > 0.0) || !isfinite(step)) {
        return fail(self, "the communication step is %g s; it must be above 0", step);
    }
    if (fabs(point - model->time) > TIME_TOLERANCE * step) {
        return fail(self, "the step begins at %.9g s, where the model is at %.9g s", point,
                    model->time);
    }
    status = move(self, step);
    if (status == fmi3OK) {
        model->time = point + step;
        *last_successful_time = model->time;
    }
    return status;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance instance)
{
    ((Instance *)instance)->model.mode = TERMINATED;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance instance)
{
    reset(instance);
    return fmi3OK;
}

/* --- Variables ----------------------------------------------------------------------------- */

EXPORT fmi3Status fmi3GetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                                 size_t count, fmi3Float64 values[], size_t values_count)
{
    Instance *self = instance;
    Model *model = &self->model;

    if (values_count != count) {
        return fail(self, "every variable has one value");
    }
    for (size_t i = 0; i < count; i++) {
        fmi3ValueReference reference = references[i];

        if (reference == VARIABLE_TIME) {
            values[i] = model->time;
        } else if (reference == VARIABLE_INPUT) {
            values[i] = model->input;
        } else if (reference - VARIABLE_PARAMETERS < PARAMETERS) {
            values[i] = model->parameters[reference - VARIABLE_PARAMETERS];
        } else if (reference >= VARIABLE_SHAFT && reference < VARIABLE_END) {
            if (model->mode == INITIALIZATION_MODE && !model->settled && settle(self) != fmi3OK) {
                return fmi3Error;
            }
            values[i] = read_output(model, reference);
        } else {
            return fail(self, "there is no variable %u of type Float64", (unsigned)reference);
        }
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(fmi3Instance instance, const fmi3ValueReference references[],
                                 size_t count, const fmi3Float64 values[], size_t values_count)
{
    Instance *self = instance;
    Model *model = &self->model;

    if (values_count != count) {
        return fail(self, "every variable has one value");
    }
    for (size_t i = 0; i < count; i++) {
        uint32_t number = references[i] - VARIABLE_PARAMETERS;

        if (references[i] == VARIABLE_INPUT) {
            if (!isfinite(values[i])) {
                return fail(self, "the input must be a finite number");
            }
            model->input = values[i];
        } else if (number < PARAMETERS) {
            const Parameter *parameter = &LEG_PARAMETERS[number];

            if (model->mode != INSTANTIATED && model->mode != INITIALIZATION_MODE) {
                return fail(self, "%s is fixed once a simulation has begun", parameter->name);
            }
            if (!isfinite(values[i]) || values[i] < parameter->min) {
                return fail(self, "%s is %g; it must be finite and %g or more", parameter->name,
                            values[i], parameter->min);
            }
            model->parameters[number] = values[i];
            model->settled = false;
        } else {
            return fail(self, "variable %u cannot be set", (unsigned)references[i]);
        }
    }
    return fmi3OK;
}

/* All variables are of type Float64. Some programs ask for none of another type. */
static fmi3Status refuse_type(const Instance *instance, size_t count)
{
    return count == 0 ? fmi3OK : fail(instance, "all variables are of type Float64");
}

#define REFUSE_TYPE(TYPE)                                                                          \
    EXPORT fmi3Status fmi3Get##TYPE(fmi3Instance instance, const fmi3ValueReference references[],  \
                                    size_t count, fmi3##TYPE values[], size_t values_count)        \
    {                                                                                              \
        (void)references;                                                                          \
        (void)values;                                                                              \
        (void)values_count;                                                                        \
        return refuse_type(instance, count);                                                       \
    }                                                                                              \
    EXPORT fmi3Status fmi3Set##TYPE(fmi3Instance instance, const fmi3ValueReference references[],  \
                                    size_t count, const fmi3##TYPE values[], size_t values_count)  \
    {                                                                                              \
        (void)references;                                                                          \
        (void)values;                                                                              \
        (void)values_count;                                                                        \
        return refuse_type(instance, count);                                                       \
    }

REFUSE_TYPE(Float32)
REFUSE_TYPE(Int8)
REFUSE_TYPE(UInt8)
REFUSE_TYPE(Int16)
REFUSE_TYPE(UInt16)
REFUSE_TYPE(Int32)
REFUSE_TYPE(UInt32)
REFUSE_TYPE(Int64)
REFUSE_TYPE(UInt64)
REFUSE_TYPE(Boolean)
REFUSE_TYPE(String)

EXPORT fmi3Status fmi3GetBinary(fmi3Instance instance, const fmi3ValueReference references[],
                                size_t count, size_t sizes[], fmi3Binary values[],
                                size_t values_count)
{
    (void)references;
    (void)sizes;
    (void)values;
    (void)values_count;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3SetBinary(fmi3Instance instance, const fmi3ValueReference references[],
                                size_t count, const size_t sizes[], const fmi3Binary values[],
                                size_t values_count)
{
    (void)references;
    (void)sizes;
    (void)values;
    (void)values_count;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3GetClock(fmi3Instance instance, const fmi3ValueReference references[],
                               size_t count, fmi3Clock values[])
{
    (void)references;
    (void)values;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3SetClock(fmi3Instance instance, const fmi3ValueReference references[],
                               size_t count, const fmi3Clock values[])
{
    (void)references;
    (void)values;
    return refuse_type(instance, count);
}

/* --- Saved states -------------------------------------------------------------------------- */

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    Instance *self = instance;

    if (*state == NULL) {
        *state = malloc(sizeof(Model));
    }
    if (*state == NULL) {
        return fail(self, "no memory for a state");
    }
    memcpy(*state, &self->model, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance instance, fmi3FMUState state)
{
    Instance *self = instance;

    if (state == NULL) {
        return fail(self, "there is no state to set");
    }
    memcpy(&self->model, state, sizeof(Model));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance instance, fmi3FMUState *state)
{
    (void)instance;
    if (state != NULL) {
        free(*state);
        *state = NULL;
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance instance, fmi3FMUState state,
                                             size_t *size)
{
    (void)instance;
    (void)state;
    *size = sizeof(Model);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance instance, fmi3FMUState state,
                                        fmi3Byte bytes[], size_t size)
{
    Instance *self = instance;

    if (state == NULL || size != sizeof(Model)) {
        return fail(self, "a state has %u bytes", (unsigned)sizeof(Model));
    }
    memcpy(bytes, state, size);
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance instance, const fmi3Byte bytes[],
                                          size_t size, fmi3FMUState *state)
{
    Instance *self = instance;

    if (size != sizeof(Model)) {
        return fail(self, "a state has %u bytes", (unsigned)sizeof(Model));
    }
    if (*state == NULL) {
        *state = malloc(sizeof(Model));
    }
    if (*state == NULL) {
        return fail(self, "no memory for a state");
    }
    memcpy(*state, bytes, size);
    return fmi3OK;
}

/* --- What the standard wants every model to have, and this one does not offer ---------------- */

static fmi3Status refuse(const Instance *instance)
{
    return fail(instance, "this model is for co-simulation, without events, clocks or derivatives");
}

#define REFUSE_MODE(NAME)                                                                          \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance instance)                                            \
    {                                                                                              \
        return refuse(instance);                                                                   \
    }

REFUSE_MODE(EnterEventMode)
REFUSE_MODE(EnterConfigurationMode)
REFUSE_MODE(ExitConfigurationMode)
REFUSE_MODE(EvaluateDiscreteStates)
REFUSE_MODE(EnterContinuousTimeMode)
REFUSE_MODE(EnterStepMode)

EXPORT fmi3Status fmi3GetNumberOfVariableDependencies(fmi3Instance instance,
                                                      fmi3ValueReference reference, size_t *count)
{
    (void)reference;
    (void)count;
    return refuse(instance);
}

EXPORT fmi3Status fmi3GetVariableDependencies(fmi3Instance instance, fmi3ValueReference dependent,
                                              size_t elements_of_dependent[],
                                              fmi3ValueReference independents[],
                                              size_t elements_of_independents[],
                                              fmi3DependencyKind kinds[], size_t count)
{
    (void)dependent;
    (void)elements_of_dependent;
    (void)independents;
    (void)elements_of_independents;
    (void)kinds;
    (void)count;
    return refuse(instance);
}

#define REFUSE_DERIVATIVE(NAME)                                                                    \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance instance, const fmi3ValueReference unknowns[],       \
                                 size_t unknowns_count, const fmi3ValueReference knowns[],         \
                                 size_t knowns_count, const fmi3Float64 seed[],                    \
                                 size_t seed_count, fmi3Float64 sensitivity[],                     \
                                 size_t sensitivity_count)                                         \
    {                                                                                              \
        (void)unknowns;                                                                            \
        (void)unknowns_count;                                                                      \
        (void)knowns;                                                                              \
        (void)knowns_count;                                                                        \
        (void)seed;                                                                                \
        (void)seed_count;                                                                          \
        (void)sensitivity;                                                                         \
        (void)sensitivity_count;                                                                   \
        return refuse(instance);                                                                   \
    }

REFUSE_DERIVATIVE(GetDirectionalDerivative)
REFUSE_DERIVATIVE(GetAdjointDerivative)

EXPORT fmi3Status fmi3GetOutputDerivatives(fmi3Instance instance,
                                           const fmi3ValueReference references[], size_t count,
                                           const fmi3Int32 orders[], fmi3Float64 values[],
                                           size_t values_count)
{
    (void)references;
    (void)count;
    (void)orders;
    (void)values;
    (void)values_count;
    return refuse(instance);
}

EXPORT fmi3Status fmi3UpdateDiscreteStates(fmi3Instance instance, fmi3Boolean *need_update,
                                           fmi3Boolean *terminate, fmi3Boolean *nominals_changed,
                                           fmi3Boolean *values_changed,
                                           fmi3Boolean *next_event_defined,
                                           fmi3Float64 *next_event_time)
{
    (void)need_update;
    (void)terminate;
    (void)nominals_changed;
    (void)values_changed;
    (void)next_event_defined;
    (void)next_event_time;
    return refuse(instance);
}

EXPORT fmi3Status fmi3CompletedIntegratorStep(fmi3Instance instance,
                                              fmi3Boolean no_set_state_before,
                                              fmi3Boolean *enter_event_mode,
                                              fmi3Boolean *terminate)
{
    (void)no_set_state_before;
    (void)enter_event_mode;
    (void)terminate;
    return refuse(instance);
}

EXPORT fmi3Status fmi3SetTime(fmi3Instance instance, fmi3Float64 time)
{
    (void)time;
    return refuse(instance);
}

EXPORT fmi3Status fmi3SetContinuousStates(fmi3Instance instance, const fmi3Float64 states[],
                                          size_t count)
{
    (void)states;
    (void)count;
    return refuse(instance);
}

#define REFUSE_STATES(NAME)                                                                        \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance instance, fmi3Float64 values[], size_t count)        \
    {                                                                                              \
        (void)values;                                                                              \
        (void)count;                                                                               \
        return refuse(instance);                                                                   \
    }

REFUSE_STATES(GetContinuousStateDerivatives)
REFUSE_STATES(GetEventIndicators)
REFUSE_STATES(GetContinuousStates)
REFUSE_STATES(GetNominalsOfContinuousStates)

#define REFUSE_COUNT(NAME)                                                                         \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance instance, size_t *count)                             \
    {                                                                                              \
        (void)count;                                                                               \
        return refuse(instance);                                                                   \
    }

REFUSE_COUNT(GetNumberOfEventIndicators)
REFUSE_COUNT(GetNumberOfContinuousStates)

EXPORT fmi3Status fmi3ActivateModelPartition(fmi3Instance instance, fmi3ValueReference clock,
                                             fmi3Float64 time)
{
    (void)clock;
    (void)time;
    return refuse(instance);
}

#define REFUSE_CLOCK(NAME, VALUE)                                                                  \
    EXPORT fmi3Status fmi3##NAME(fmi3Instance instance, const fmi3ValueReference references[],     \
                                 size_t count, VALUE values[])                                     \
    {                                                                                              \
        (void)references;                                                                          \
        (void)values;                                                                              \
        return refuse_type(instance, count);                                                       \
    }

REFUSE_CLOCK(GetShiftDecimal, fmi3Float64)
REFUSE_CLOCK(SetShiftDecimal, const fmi3Float64)
REFUSE_CLOCK(SetIntervalDecimal, const fmi3Float64)

EXPORT fmi3Status fmi3GetIntervalDecimal(fmi3Instance instance,
                                         const fmi3ValueReference references[], size_t count,
                                         fmi3Float64 intervals[],
                                         fmi3IntervalQualifier qualifiers[])
{
    (void)references;
    (void)intervals;
    (void)qualifiers;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3GetIntervalFraction(fmi3Instance instance,
                                          const fmi3ValueReference references[], size_t count,
                                          fmi3UInt64 counters[], fmi3UInt64 resolutions[],
                                          fmi3IntervalQualifier qualifiers[])
{
    (void)references;
    (void)counters;
    (void)resolutions;
    (void)qualifiers;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3GetShiftFraction(fmi3Instance instance,
                                       const fmi3ValueReference references[], size_t count,
                                       fmi3UInt64 counters[], fmi3UInt64 resolutions[])
{
    (void)references;
    (void)counters;
    (void)resolutions;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3SetIntervalFraction(fmi3Instance instance,
                                          const fmi3ValueReference references[], size_t count,
                                          const fmi3UInt64 counters[],
                                          const fmi3UInt64 resolutions[])
{
    (void)references;
    (void)counters;
    (void)resolutions;
    return refuse_type(instance, count);
}

EXPORT fmi3Status fmi3SetShiftFraction(fmi3Instance instance,
                                       const fmi3ValueReference references[], size_t count,
                                       const fmi3UInt64 counters[],
                                       const fmi3UInt64 resolutions[])
{
    (void)references;
    (void)counters;
    (void)resolutions;
    return refuse_type(instance, count);
}
