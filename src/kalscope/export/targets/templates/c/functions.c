${linkage}void kalscope_start(kalscope_filter *filter, const kalscope_tuning *tuning)
{
    filter->tuning = *tuning;
@classic     filter->x = NAN;
$starts}
$updates
@chain 
@chain ${linkage}kalscope_real kalscope_update(kalscope_filter *filter, kalscope_real z)
@chain {
@chain ${before}    switch (filter->tuning.filter) {
@chain ${cases}    default: return filter->x;
@chain     }
@chain }
