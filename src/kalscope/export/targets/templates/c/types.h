@chain /* The filters of this export. */
@chain enum { $kinds };
@chain 
typedef struct {
@chain     int filter;                 /* one of these */
$tuning_fields} kalscope_tuning;

typedef struct {
    kalscope_tuning tuning; /* $changing */
    kalscope_real x;        /* filtered value; NAN before the first sample */
$state_fields} kalscope_filter;
