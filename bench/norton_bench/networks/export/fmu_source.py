"""The C text of a co-simulation FMU, FMI 3.0. Marks between @ signs are filled in by ``fmu``."""

SOURCE = r"""/* Co-simulation FMU (FMI 3.0) of an equivalent network, exported by norton-bench. */
#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include "@NAME@.h"

#if defined _WIN32 || defined __CYGWIN__
#define EXPORT __declspec(dllexport)
#else
#define EXPORT __attribute__((visibility("default")))
#endif

typedef void *fmi3Instance;
typedef void *fmi3InstanceEnvironment;
typedef void *fmi3FMUState;
typedef uint32_t fmi3ValueReference;
typedef double fmi3Float64;
typedef bool fmi3Boolean;
typedef const char *fmi3String;
typedef uint8_t fmi3Byte;
typedef enum { fmi3OK, fmi3Warning, fmi3Discard, fmi3Error, fmi3Fatal } fmi3Status;
typedef void (*fmi3LogMessageCallback)(fmi3InstanceEnvironment, fmi3Status, fmi3String, fmi3String);
typedef void (*fmi3IntermediateUpdateCallback)(void);
typedef void (*fmi3ClockUpdateCallback)(void);
typedef void (*fmi3LockPreemptionCallback)(void);
typedef void (*fmi3UnlockPreemptionCallback)(void);
typedef int fmi3DependencyKind;
typedef int fmi3IntervalQualifier;

/* All that a state of the FMU is: copied whole by fmi3GetFMUState and written whole by fmi3SerializeFMUState. */
typedef struct {
    double state[@STATES@];
    double command[@ROOM@];
    double port[@PORT@];
    double time;
} Whole;

typedef struct {
    Whole now;
    fmi3LogMessageCallback log;
    fmi3InstanceEnvironment environment;
} Instance;

static void begin(Instance *instance)
{
    @NAME@_network first;
    memset(&instance->now, 0, sizeof instance->now);
    @NAME@_start(&first);
    memcpy(instance->now.state, first.state, sizeof instance->now.state);
}

static fmi3Status complain(const Instance *instance, const char *text)
{
    if (instance != NULL && instance->log != NULL)
        instance->log(instance->environment, fmi3Error, "logStatusError", text);
    return fmi3Error;
}

/* An input's place, or NULL. */
static double *input(Instance *instance, fmi3ValueReference reference)
{
    if (reference >= 1 && reference < 1 + @COMMANDS@)
        return &instance->now.command[reference - 1];
    if (reference >= @FIRST_PORT@ && reference < @FIRST_PORT@ + @PORT@)
        return &instance->now.port[reference - @FIRST_PORT@];
    return NULL;
}

/* The port as its own derivatives say, dt_s later; an exertion stays. */
static void go_on(const double *from, double dt_s, double *to)
{
    memcpy(to, from, @PORT@ * sizeof *to);
#if @MOTION@
    to[0] += dt_s * (from[1] + 0.5 * dt_s * from[2]);
    to[1] += dt_s * from[2];
#else
    (void)dt_s;
#endif
}

EXPORT const char *fmi3GetVersion(void)
{
    return "3.0";
}

EXPORT fmi3Status fmi3SetDebugLogging(fmi3Instance i, fmi3Boolean on, size_t n, const fmi3String categories[])
{
    (void)i; (void)on; (void)n; (void)categories;
    return fmi3OK;
}

EXPORT fmi3Instance fmi3InstantiateCoSimulation(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3Boolean events, fmi3Boolean early, const fmi3ValueReference required[], size_t n,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3IntermediateUpdateCallback update)
{
    Instance *instance;
    (void)name; (void)resources; (void)visible; (void)events; (void)early; (void)required; (void)n; (void)update;
    if (token == NULL || strcmp(token, "@TOKEN@") != 0)
        return NULL;
    instance = calloc(1, sizeof *instance);
    if (instance == NULL)
        return NULL;
    instance->log = logging ? log : NULL;
    instance->environment = environment;
    begin(instance);
    return instance;
}

EXPORT void fmi3FreeInstance(fmi3Instance i)
{
    free(i);
}

EXPORT fmi3Status fmi3EnterInitializationMode(
    fmi3Instance i, fmi3Boolean defined, fmi3Float64 tolerance, fmi3Float64 start, fmi3Boolean stops, fmi3Float64 stop)
{
    (void)defined; (void)tolerance; (void)stops; (void)stop;
    ((Instance *)i)->now.time = start;
    return fmi3OK;
}

EXPORT fmi3Status fmi3ExitInitializationMode(fmi3Instance i)
{
    (void)i;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Terminate(fmi3Instance i)
{
    (void)i;
    return fmi3OK;
}

EXPORT fmi3Status fmi3Reset(fmi3Instance i)
{
    begin(i);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFloat64(
    fmi3Instance i, const fmi3ValueReference references[], size_t n, const fmi3Float64 values[], size_t count)
{
    if (n != count)
        return complain(i, "as many values as value references are needed");
    for (size_t k = 0; k < n; ++k) {
        double *place = input(i, references[k]);
        if (place == NULL)
            return complain(i, "only inputs can be set");
        *place = values[k];
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFloat64(
    fmi3Instance i, const fmi3ValueReference references[], size_t n, fmi3Float64 values[], size_t count)
{
    Instance *instance = i;
    double out[@OUTPUTS@];
    if (n != count)
        return complain(i, "as many values as value references are needed");
    @NAME@_outputs(instance->now.state, instance->now.command, instance->now.port, out);
    for (size_t k = 0; k < n; ++k) {
        const fmi3ValueReference reference = references[k];
        const double *place = input(instance, reference);
        if (reference == 0)
            values[k] = instance->now.time;
        else if (place != NULL)
            values[k] = *place;
        else if (reference >= @FIRST_OUTPUT@ && reference < @FIRST_OUTPUT@ + @OUTPUTS@)
            values[k] = out[reference - @FIRST_OUTPUT@];
        else
            return complain(i, "there is no variable with this value reference");
    }
    return fmi3OK;
}

EXPORT fmi3Status fmi3DoStep(
    fmi3Instance i, fmi3Float64 now, fmi3Float64 dt_s, fmi3Boolean kept, fmi3Boolean *event, fmi3Boolean *terminate,
    fmi3Boolean *early, fmi3Float64 *last)
{
    Instance *instance = i;
    double to[@PORT@];
    (void)kept;
    *event = *terminate = *early = false;
    *last = now;
    if (!(dt_s > 0.0))
        return complain(i, "the step must be longer than zero");
    go_on(instance->now.port, dt_s, to);
    @NAME@_advance(instance->now.state, dt_s, instance->now.command, instance->now.port, to);
    memcpy(instance->now.port, to, sizeof to);
    *last = instance->now.time = now + dt_s;
    for (size_t k = 0; k < sizeof instance->now.state / sizeof *instance->now.state; ++k)
        if (!isfinite(instance->now.state[k]))
            return complain(i, "the states do not stay finite");
    return fmi3OK;
}

EXPORT fmi3Status fmi3GetFMUState(fmi3Instance i, fmi3FMUState *kept)
{
    if (*kept == NULL)
        *kept = malloc(sizeof(Whole));
    if (*kept == NULL)
        return complain(i, "there is no memory left");
    memcpy(*kept, &((Instance *)i)->now, sizeof(Whole));
    return fmi3OK;
}

EXPORT fmi3Status fmi3SetFMUState(fmi3Instance i, fmi3FMUState kept)
{
    memcpy(&((Instance *)i)->now, kept, sizeof(Whole));
    return fmi3OK;
}

EXPORT fmi3Status fmi3FreeFMUState(fmi3Instance i, fmi3FMUState *kept)
{
    (void)i;
    free(*kept);
    *kept = NULL;
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializedFMUStateSize(fmi3Instance i, fmi3FMUState kept, size_t *size)
{
    (void)i; (void)kept;
    *size = sizeof(Whole);
    return fmi3OK;
}

EXPORT fmi3Status fmi3SerializeFMUState(fmi3Instance i, fmi3FMUState kept, fmi3Byte bytes[], size_t size)
{
    if (size < sizeof(Whole))
        return complain(i, "there is no room for the state");
    memcpy(bytes, kept, sizeof(Whole));
    return fmi3OK;
}

EXPORT fmi3Status fmi3DeserializeFMUState(fmi3Instance i, const fmi3Byte bytes[], size_t size, fmi3FMUState *kept)
{
    if (size != sizeof(Whole))
        return complain(i, "this is no state of this FMU");
    if (*kept == NULL)
        *kept = malloc(sizeof(Whole));
    if (*kept == NULL)
        return complain(i, "there is no memory left");
    memcpy(*kept, bytes, sizeof(Whole));
    return fmi3OK;
}
"""

# The standard wants every function of the interface to be there; these say that the FMU has nothing of the kind.
_VALUE_TYPES = (
    ("Float32", "float"),
    ("Int8", "int8_t"),
    ("UInt8", "uint8_t"),
    ("Int16", "int16_t"),
    ("UInt16", "uint16_t"),
    ("Int32", "int32_t"),
    ("UInt32", "uint32_t"),
    ("Int64", "int64_t"),
    ("UInt64", "uint64_t"),
    ("Boolean", "bool"),
    ("String", "fmi3String"),
)
_REFERENCES = "fmi3Instance i, const fmi3ValueReference references[], size_t n"
_SENSITIVITY = (
    "fmi3Instance i, const fmi3ValueReference unknowns[], size_t nu, const fmi3ValueReference knowns[], size_t nk, "
    "const fmi3Float64 seed[], size_t ns, fmi3Float64 sensitivity[], size_t nv"
)
_OTHERS = (
    *((f"Get{name}", f"{_REFERENCES}, {kind} values[], size_t count") for name, kind in _VALUE_TYPES),
    *((f"Set{name}", f"{_REFERENCES}, const {kind} values[], size_t count") for name, kind in _VALUE_TYPES),
    ("GetBinary", f"{_REFERENCES}, size_t sizes[], const fmi3Byte *values[], size_t count"),
    ("SetBinary", f"{_REFERENCES}, const size_t sizes[], const fmi3Byte *const values[], size_t count"),
    ("GetClock", f"{_REFERENCES}, bool values[]"),
    ("SetClock", f"{_REFERENCES}, const bool values[]"),
    ("EnterEventMode", "fmi3Instance i"),
    ("EnterStepMode", "fmi3Instance i"),
    ("EnterConfigurationMode", "fmi3Instance i"),
    ("ExitConfigurationMode", "fmi3Instance i"),
    ("EvaluateDiscreteStates", "fmi3Instance i"),
    (
        "UpdateDiscreteStates",
        "fmi3Instance i, fmi3Boolean *update, fmi3Boolean *terminate, fmi3Boolean *nominals, fmi3Boolean *values, "
        "fmi3Boolean *defined, fmi3Float64 *next",
    ),
    ("GetNumberOfVariableDependencies", "fmi3Instance i, fmi3ValueReference reference, size_t *n"),
    (
        "GetVariableDependencies",
        "fmi3Instance i, fmi3ValueReference dependent, size_t elements[], fmi3ValueReference independents[], "
        "size_t theirs[], fmi3DependencyKind kinds[], size_t n",
    ),
    ("GetDirectionalDerivative", _SENSITIVITY),
    ("GetAdjointDerivative", _SENSITIVITY),
    ("GetIntervalDecimal", f"{_REFERENCES}, fmi3Float64 intervals[], fmi3IntervalQualifier qualifiers[]"),
    (
        "GetIntervalFraction",
        f"{_REFERENCES}, uint64_t counters[], uint64_t resolutions[], fmi3IntervalQualifier qualifiers[]",
    ),
    ("GetShiftDecimal", f"{_REFERENCES}, fmi3Float64 shifts[]"),
    ("GetShiftFraction", f"{_REFERENCES}, uint64_t counters[], uint64_t resolutions[]"),
    ("SetIntervalDecimal", f"{_REFERENCES}, const fmi3Float64 intervals[]"),
    ("SetIntervalFraction", f"{_REFERENCES}, const uint64_t counters[], const uint64_t resolutions[]"),
    ("SetShiftDecimal", f"{_REFERENCES}, const fmi3Float64 shifts[]"),
    ("SetShiftFraction", f"{_REFERENCES}, const uint64_t counters[], const uint64_t resolutions[]"),
    ("EnterContinuousTimeMode", "fmi3Instance i"),
    ("CompletedIntegratorStep", "fmi3Instance i, fmi3Boolean kept, fmi3Boolean *event, fmi3Boolean *terminate"),
    ("SetTime", "fmi3Instance i, fmi3Float64 time"),
    ("SetContinuousStates", "fmi3Instance i, const fmi3Float64 states[], size_t n"),
    ("GetContinuousStates", "fmi3Instance i, fmi3Float64 states[], size_t n"),
    ("GetContinuousStateDerivatives", "fmi3Instance i, fmi3Float64 derivatives[], size_t n"),
    ("GetNominalsOfContinuousStates", "fmi3Instance i, fmi3Float64 nominals[], size_t n"),
    ("GetNumberOfContinuousStates", "fmi3Instance i, size_t *n"),
    ("GetEventIndicators", "fmi3Instance i, fmi3Float64 indicators[], size_t n"),
    ("GetNumberOfEventIndicators", "fmi3Instance i, size_t *n"),
    ("ActivateModelPartition", "fmi3Instance i, fmi3ValueReference clock, fmi3Float64 time"),
    ("GetOutputDerivatives", f"{_REFERENCES}, const int32_t orders[], fmi3Float64 values[], size_t count"),
)


def _refusal(name: str, parameters: str) -> str:
    names = [parameter.replace("[]", "").replace("*", " ").split()[-1] for parameter in parameters.split(", ")]
    unused = " ".join(f"(void){each};" for each in names if each != "i")
    body = f'    {unused}\n    return complain(i, "fmi3{name}: this FMU has nothing of the kind");'
    return f"\nEXPORT fmi3Status fmi3{name}({parameters})\n{{\n{body}\n}}\n"


_NO_INSTANCE = r"""
EXPORT fmi3Instance fmi3InstantiateModelExchange(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    return NULL;
}

EXPORT fmi3Instance fmi3InstantiateScheduledExecution(
    fmi3String name, fmi3String token, fmi3String resources, fmi3Boolean visible, fmi3Boolean logging,
    fmi3InstanceEnvironment environment, fmi3LogMessageCallback log, fmi3ClockUpdateCallback update,
    fmi3LockPreemptionCallback lock, fmi3UnlockPreemptionCallback unlock)
{
    (void)name; (void)token; (void)resources; (void)visible; (void)logging; (void)environment; (void)log;
    (void)update; (void)lock; (void)unlock;
    return NULL;
}
"""

UNSUPPORTED = "".join(_refusal(*each) for each in _OTHERS) + _NO_INSTANCE
