"""Names that a RAPID controller has already: data types, instructions, functions and data.

They are those of the RAPID reference manuals and of the options of a controller, as the public list
of KnoP-01/rapid-for-vim has them. A program of this post has none of them, whether the controller
has the option or not. No list is shared with the reader of RAPID.
"""

from __future__ import annotations

_DATA_TYPES = """
    accdata adaptdata advseamdata aiotrigg arcdata arctrackdata be_device be_scan be_tooldesign
    beaddata bool btnres busstate buttondata byte cameradev cameratarget capaptrreferencedata
    capdata capevent caplatrackdata capmvsttim capspeeddata capstopmode captestno captrackdata
    capweavedata cfgdomain clock cnvcmd confdata confsupdata corrdescr css_offset_dir
    css_soft_dir cssframe dadescapp dadescprc daintdata datapos deflectiondata dionum dir dnum
    ee_event egm_minmax egmframetype egmident egmstate egmstopmode equipdata errdomain errnum
    errorinfo errstr errtype event_type exec_level extjoint fcboxvol fccondstatus fccylindervol
    fcdamping fcforcevector fcframe fclindir fcplane fcprocessdata fcrotdir fcspdchgtunetype
    fcspeedvector fcspherevol fcxyznum flypointdata flystartdata forcedata gundata gunnum
    handler_type icondata identno indcnvdata inposdata intnum inttypes iodev iounit_state
    jointtarget listitem loaddata loadidnum loadsession mecunit menudata motionprocessmode
    motsetdata multidata num o_jointtarget o_robtarget opcalc opnum opttrackdata orient paridnum
    paridvalidnum partadv partdata pathrecid pnpdata pos pose proc_times processtimes progdisp
    rawbytes restartblkdata restartdata rmqheader rmqmessage rmqslot robjoint robtarget seamdata
    searchdata sensor sensorstate sensorvardata shapedata signalai signalao signaldi signaldo
    signalgi signalgo signalorigin simdata singdata smeqdata smeqtype socketdev socketstatus
    speeddata spotdata standno stopmovestartmove_mem stoppoint stoppointdata string stringdig
    sup_timeouts supervtimeouts supervtype switch symnum syncident taskid tasks tasksatstart
    testsignal tooldata toolinfo toolno tpnum trackdata trapdata triggdata triggflag triggios
    triggiosdnum triggmode triggstrgo tsp_status tunegtype tunetype uishownum veldata visiondata
    weavedata weavestartdata welddata wobjdata wzstationary wztemporary zonedata"""
_INSTRUCTIONS = """
    accset acteventbuffer activateprofile actunit add aliascamera aliasio aliasioreset arcadaptc
    arcadaptcend arcadaptl arcadaptlend arcadaptlstart arcadaptrepl arcc arcc1 arcc1end
    arcc1start arcc2 arcc2end arcc2start arccalcc arccalccend arccalcl arccalclend arccalclstart
    arccend arccstart arckill arcl arcl1 arcl1end arcl1start arcl2 arcl2end arcl2start arclend
    arclstart arcmoveextj arcrefresh arcrepl bechecktcp bedebugstate berefpointer besetuptoolj
    betcpextend beupdatetcp bitclear bitset bookerrno bp_lin bp_ptp brakecheck break bu_circ
    bu_lin bua_circ bua_lin bua_messenlin bua_messenptp bz_lin bz_ptp calibj calibl calibrate
    callbyvar camflush camgetparameter camgetresult camloadjob camreqimage camsetexposure
    camsetparameter camsetprogrammode camsetrunmode camstartloadjob camwaitloadjob cancelload
    capaptrsetup capaptrsetupai capaptrsetupao capaptrsetuppers capc capcondsetdo capequidist
    capl caplatrsetup capnoprocess caprefresh capsetstopmode capweavesync checkprogref
    circlepathmode cirpathmode clear cleariobuff clearpath clearrawbytes clkreset clkstart
    clkstop close closedir closegun closehighlift cnvgeninstr cnvpredictreach cnvsync confj
    confl consolewrite contactl copyfile copyrawbytes cornerpathwarning corrclear corrcon
    corrdiscon corrwrite cssact cssdeact cssdeactmovel cssforceoffsetact cssforceoffsetdeact
    cssoffsettune cyclicbrakecheck cz_lin cz_lin_v cz_ptp cz_ptp_v da_lin daactproc
    dadeactallproc dadeactproc dadefextsig dadefprocdata dadefprocsig dadefuserdata
    dagetappdescr dagetappindex dagetcurrdata dagetnumofprocs dagetnumofrob dagetprcdescr
    daprocmj daprocml dasetcurrdata dasetupappbehav dastartmanaction deacteventbuffer
    deactprofile deactunit decr dispc displ ditheract ditherdeact dropsensor dropwobj
    egmactjoint egmactmove egmactpose egmgetid egmmovec egmmovel egmreset egmrunjoint egmrunpose
    egmsetupai egmsetupao egmsetupgi egmsetupltapp egmsetupuc egmstop egmstreamstart
    egmstreamstop eoffsoff eoffson eoffsset erasemodule errlog errraise errwrite execengine
    exitcycle fcact fccalib fccondforce fccondorient fccondpos fccondreorispeed fccondtcpspeed
    fccondtorque fccondwaitwhile fcdeact fcpress1lstart fcpressc fcpressend fcpressl fcrefcircle
    fcrefforce fcrefline fcrefmoveframe fcrefrot fcrefspiral fcrefsprforcecart fcrefstart
    fcrefstop fcreftorque fcresetdampingtune fcresetlpfiltertune fcsetdampingtune
    fcsetlpfiltertune fcspdchgact fcspdchgdeact fcspdchgtunreset fcspdchgtunset fcsupvforce
    fcsupvorient fcsupvpos fcsupvreorispeed fcsupvtcpspeed fcsupvtorque fd_lin fd_ptp fitcircle
    fricidevaluate fricidinit fricidsetfriclevels gbl_lin gbl_ptp gbl_refpointlin getdataval
    getgroupsignalinfo getjointdata getmaxusagetime getnextsym getsysdata gettorquemargin
    gettrapdata gripload hand_domotorcalibration hand_gripinward hand_gripoutward
    hand_initialize hand_joginward hand_jogoutward hand_moveto hand_seterror hand_stop
    hollowwristreset hr_contmove hr_exit hr_exitcycle hr_moveback hr_moveroutine hr_moveto
    hr_movetohome hr_savepos hr_setmovetostartpos hr_settypedindex hr_settypeindex icap idelete
    idisable ienable ierror incr indamove indcmove indcnvaddobject indcnvdisable indcnvenable
    indcnvinit indcnvreset inddmove indgunmove indgunmovereset indreset indrmove initsuperv
    invertdo iobusstart iobusstate ioctrlaxis_refsync ioctrlaxis_refsyncoff ioctrlaxis_refsyncon
    iodisable ioenable ipathpos ipers ipssetparam irmqmessage isignalai isignalao isignaldi
    isignaldo isignalgi isignalgo isleep itimer ivarvalue iwatch ke_lin kg_lin kg_ptp kl_circ
    kl_lin kw_loesenlin lk_circ lk_lin ll_circ ll_lin load loadid loadprofile ls_circ ls_lin
    ls_lin_f ls_ptp_f lw_circ lw_lin lz_lin lz_ptp lz_reinigenlin lz_reinigenptp makedir
    manloadidproc matrixsolve matrixsolveqr matrixsvd measurewearl mechunitload
    motionprocessmodeset motionsup moveabs moveabs_ao moveabs_do moveabs_fb moveabs_frg
    moveabs_go moveabs_rob moveabsj movec movecao movecdo movecgo movecirc movecirc_ao
    movecirc_do movecirc_fb movecirc_frg movecirc_go movecirc_rob movecsync moveextj movej
    movejao movejdo movejgo movejsync movel movelao moveldo movelgo movelin movelin_ao
    movelin_do movelin_fb movelin_frg movelin_go movelin_rob movelsync movepnp moveptp
    moveptp_fb moveptp_frg moveptp_rob mploadpath mpoffseaxonpath mpreadinpath mpsavepath
    ms_circ ms_lin ms_lin_cs ms_ptp_cs ms_reinigenlin ms_searchlin mtoolrotcalib mtooltcpcalib
    nk_lin nutj nutl nz_lin nz_lin_v nz_ptp nz_ptp_v open opendir opengun openhighlift
    packdnheader packrawbytes paintc paintl paintldo paintlsig pathacclim pathlengthreset
    pathlengthstart pathlengthstop pathrecmovebwd pathrecmovefwd pathrecstart pathrecstop
    pathresol pdispoff pdispon pdispset pmgrgetnextpart pmgrrunmenu pmgrsetnextpart
    pntproduserlog pr_lin pr_ptp procerrrecovery prxactivandstorerecord prxactivrecord
    prxdbgstorerecord prxdeactrecord prxresetpos prxresetrecords prxsetposoffset
    prxsetrecordsampletime prxsetsyncalarm prxstartrecord prxstoprecord prxstorerecord
    prxusefilerecord pulsedo raisetouser readanybin readblock readcfgdata readdir readerrdata
    readrawbytes readvararr recalctcp recordprofile recoverymenu recoverymenuwr recoveryposreset
    recoveryposset removeallcyclicbool removecyclicbool removedir removefile removesuperv
    renamefile reset resetaxisdistance resetaxismovetime resetmaxusagetime resetppmoved
    resetretrycount resettorquemargin restopath rewind rf_circ rf_lin rmqemptyqueue rmqfindslot
    rmqgetmessage rmqgetmsgdata rmqgetmsgheader rmqreadwait rmqsendmessage rmqsendwait
    safetycontrollersyncrequest save savecfgdata scssdeactmovel scwrite search_1d search_groove
    search_part searchc searchcirc searchcirc_m searchextj searchl searchlin searchlin_m
    sendevice set setalldataval setao setbrush setbrushfac setdatasearch setdataval setdo
    setforce setgo setleadthrough setsysdata settmsignal setupcyclicbool setupsuperv
    setwrprocname siclose siconnect sigetcyclic singarea sisetcyclic skipwarn sm_lin sm_ptp
    smovej smovejdo smovejgo smovejsync smovel smoveldo smovelgo smovelsync socketaccept
    socketbind socketclose socketconnect socketcreate socketlisten socketreceive
    socketreceivefrom socketsend socketsendto softact softdeact softelbow speedlimaxis
    speedlimcheckpoint speedrefresh spotj spotl spotmj spotml spystart spystop spz_fraesenlin
    spz_fraesenptp spz_lin spz_messenlin spz_messenptp spz_ptp ssearchl startload startmove
    startmoveretry stcalib stclose stepbwdpath stindgun stindgunreset stoolrotcalib
    stooltcpcalib stop stopen stopmove stopmovereset storepath storeprofile stp_fraesenlin
    stp_fraesenptp stp_lin stp_ptp striggj striggl sttune sttunereset supsyncsensoroff
    supsyncsensoron swgetcalibdata swgetfixtipdata swsetintforcedata swsetintgundata
    swsetintsimdata swsetintspotdata syncmoveoff syncmoveon syncmoveresume syncmovesuspend
    syncmoveundo synctosensor syncwwobj systemstopaction tcclosecover tcdropofftool tclocktool
    tcopencover tcpickuptool tcunlocktool testsigndefine testsignreset texttabinstall tperase
    tpreaddnum tpreadfk tpreadnum tpshow tpwrite triggabsj triggc triggcheckio triggdatacopy
    triggdatareset triggequip triggint triggio triggj triggjios triggl trigglios triggrampao
    triggspeed triggstopproc tryint tunereset tuneservo uiclientexist uimsgbox uimsgwrite
    uimsgwriteabort uishow unload unpackrawbytes useaccprofile usereachabletargets velset waitai
    waitandrecprof waitao waitdi waitdo waitgi waitgo waitload waitrob waitsensor waitsynctask
    waittestandset waittime waituntil waitwobj warmstart worldacclim write writeanybin writebin
    writeblock writecfgdata writerawbytes writestrbin writevar writevararr wzboxdef wzcyldef
    wzdisable wzdoset wzenable wzfree wzhomejointdef wzlimjointdef wzlimsup wzsphdef"""
_FUNCTIONS = """
    abs absdnum acos acosdnum ainput aoutput argname asin asindnum atan atan2 atan2dnum atandnum
    bitand bitanddnum bitcheck bitcheckdnum bitlsh bitlshdnum bitneg bitnegdnum bitor bitordnum
    bitrsh bitrshdnum bittobyte bitxor bitxordnum bytetostr calcjointt calcrobt calcrotaxframez
    calcrotaxisframe camgetexposure camgetloadedjob camgetname camnumberofresults capgetfailsigs
    cdate cjointt clkread corrread cos cosdnum cpos crobt crossprod cspeedoverride
    ctime ctool cwobj dacheckmmsopt dagetfsttimeevt dagetmp dagetrobotname dagettaskname
    dectohex defaccframe defdframe defframe dim dinput distance dnumtonum dnumtostr dotprod
    doutput egmgetstate erase eulerzyx eventtype excel exechandler execlevel exp fcgetforce
    fcgetprocessdata fcisforcemode fcloadid filesize filetime filetimednum fssize
    getaxisdistance getaxismovetime getmaxnumberofcyclicbool getmecunitname getmodalpayloadmode
    getmotortorque getnextcyclicbool getnextmechunit getnumberofcyclicbool getserviceinfo
    getsignal getsignaldnum getsignalorigin getsysinfo gettaskname gettime gettspstatus
    getuasusername ginput ginputdnum goutput goutputdnum hextodec home hr_gettypedindex
    hr_gettypeindex hr_robotinhome indexlookup indinpos indpos indspeed iounitstate ipscommand
    ipsgetparam isbrakecheckactive iscyclicbool isfile isleadthrough ismechunitactive ispers
    isstopmoveact isstopstateevent issyncmoveon issysid isvar max maxextlinearspeed
    maxextreorientspeed maxrobreorientspeed maxrobspeed min mirpos modexist modtime modtimednum
    motionplannerno moveext nonmotionmode norient numtodnum numtostr offs offstoolpolar
    offstoolxyz opmode oporient ord orientzyx orobt paintcommand paridposvalid paridrobvalid
    pathlengthget pathlevel pathrecvalidbwd pathrecvalidfwd pfrestart pmgratsafe pmgratservice
    pmgratstate pmgratstation pmgrnextstation pmgrtaskname pmgrtasknumber pntqueueextraget
    pntqueueextraset pntqueuepeek poseinv posemult posevect pow powdnum ppmovedinmanmode present
    proccall progmemfree prxgetmaxrecordpos rawbyteslen read readbin readmotor readnum readstr
    readstrbin readvar reltool remainingretries rmqgetslotname robname robos round rounddnum
    runmode safetycontrollergetchecksum safetycontrollergetopmodepincode
    safetycontrollergetswversion safetycontrollergetuserchecksum sin sindnum socketgetstatus
    socketpeek sqrt sqrtdnum stcalcforce stcalctorque stiscalib stisclosed stisindgun stisopen
    strdigcalc strdigcmp strfind strlen strmap strmatch strmemb strorder strpart strtobyte
    strtoval swgetcurrspotname swgetcurrtargetname tan tandnum taskisactive taskisexecuting
    taskrunmec taskrunrob tasksinsync testandset testdi testsignread textget texttabfreetouse
    texttabget tpclr triggdatavalid trunc truncdnum type uialphaentry uidnumentry uidnumtune
    uilistview uimessagebox uinumentry uinumtune validio valtostr vectmagn"""
_DATA = """
    diskhome diskram disktemp fine fllwtime fllwtime0_5 fllwtime1_0 fllwtime1_5 flp1 inpos
    inpos100 inpos20 inpos50 load0 pi stempty stoptime stoptime0_5 stoptime1_0 stoptime1_5
    str_digit str_lower str_upper str_white tool0 usbdisk1 usbdisk10 usbdisk2 usbdisk3 usbdisk4
    usbdisk5 usbdisk6 usbdisk7 usbdisk8 usbdisk9 v10 v100 v1000 v150 v1500 v20 v200 v2000 v2500
    v30 v300 v3000 v40 v400 v4000 v5 v50 v500 v5000 v60 v600 v6000 v7000 v80 v800 vlin10 vlin100
    vlin1000 vlin20 vlin200 vlin50 vlin500 vmax vrot1 vrot10 vrot100 vrot2 vrot20 vrot5 vrot50
    wobj0 z0 z1 z10 z100 z15 z150 z20 z200 z30 z40 z5 z50 z60 z80"""
PREDEFINED = frozenset(f"{_DATA_TYPES} {_INSTRUCTIONS} {_FUNCTIONS} {_DATA}".split())
#: Constants of errors, which the controller numbers, begin so.
PREFIXES = ("err_", "sys_err_")
