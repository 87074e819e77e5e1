"""HDF5 files whose numbers lie in other files, as h5py 3.16 wrote them: compressed, in base 85."""

ELSEWHERE = {
    "external storage": (
        "c-rllJ5L)y5XWcNuY(X_6Dc?;BA2cr7xdv|FTs*IBOgV&#0e*1DRHFugiJ>P5_|(n%6tS$%9IEx%2!Ee?(yIA-3r-}BSk^XuNlwo?9S|Z_V#hU-P"
        "(G({BoH>EQ|6~rZf{kbwdXqAO++Z<aepdMO0Tsc?JEOc6&XgLhFfv_S4A6G8-N9SlCwfZYbYDM>^6EnY9~39zlAay~Dmg_&PN5wDE_21ueyGgx2F"
        "s79uVvz)s6tP#@M*YH!GjN;YZZ32jVr+RlpVrIb+z7W&Hxm?tBPSwW<Nih+Se&5rH5f&L6@L64`^-cgR*?mF+?rrl9NyE@txqIQnGqX_L}s-2#%G"
        "FDc-66@DV1Xd;<*Xg!IG)k=Z;_Ug;t!ug2c6wcp3y&k8=j9bXcZpm)uj=><YX3B^j*PrID9_F-f%vEM0Y5T39|dDx7F~Cxpnm~(;SP0Cx-TlC%Oq"
        "MopL%DyH1fBcN#uj1rtw$byQ=Zsx+-PuM&74yp8xveV7PcL9-q9jqrDjN2J$y#?G)u}ZYYm$V@W@u|ANji48t(Y!(atBctNYd(WRO??{(Vl9?=UN"
        "Y1VNz(&tls?UL#9Np<==t;@*IRpQ4FDtc;5^_0_8@bg^8e)ju*f8_ad<JR%)559QA(e!?2(foTxK6M_};}PaNM$w$7hZ(=%6lWNQVea8=v)d7=cM"
        "D<cL;5{V8s+AD-t{WaCBrZb!!QiPFbu=|uiOEK#*Nn"
    ),
    "external storage, new format": (
        "c-rgqaB<`1lHy|K;9!7(|4`r|0pS}!#U-qI-}!sE1TisGFbN?mgaIxl21W)3HXa5b#aOW!stwAo+|LN*i-7o?sX3`-i6xo&d8e763KbX#0ulK)T3"
        "{yt4P*qG!^FtQ$O@H%(aa(YjDiaG3=j`FFqm*NnEYo3$^%`;%*6q8IWr?vl0gHiM^uP`1=Bw~+Ca4oY(T|8NoOC&;9v$}pke_a2D#bA)7RB6*wf!"
        "HKG@mO$CZIc2Be%7qTJ8X*A=Xq35qKi1b`abSs)fxz<gxRKrU#sJ1`wRETE<{u#gZI8XTy>PlvFm1cwDb^}@oZ{kAPUEL4D&Fd@Q%6)jANODF6aK"
        "$952DVO0oGeidmnym|<G$b5hA+-R1IL3eih94MkBFLfU;~5;nAPEgnaj0FO7=>jH7!7ih2M2<U%!jDCV_WdS!__eWoMn-8fxvfWR38+lCKsia=p|"
        "+5LHPd89^O1T5EmMNTo~l)<{ISc=j;k`VHgv{g(-<8iN&cU2&blG=BDNq19LM2hX6dR6~I1VL~{c?zeB;BZL>4!X)lbg!nfo)!zdU9BONrf$T@=O"
        "6;S#Dl>Pyw6<VR<Lct)q;Sz*qxC-T82h#4&{yyN0C4idAU_~aZ@@GO5-;Cy#1N@`$F$zY(C>RB!U=)mkQ7{Td!6+C7qhJ&aRsaB0Z^bV"
    ),
    "external storage, behind a user block": (
        "c-muN7zHC4bb7eB@p4IVF>`P*Ffc*H{zHL>6ohX8RXf8nUCiIZC5VZkf=LKjAq;RaF)%VPu<<YeDaMM;P;F3t<$gveUj)SGOwCCxODxIE&pQpZmO"
        "+8Ab4BFeXn~yoG>{Q!4ih6IBP&!6Ml*{rFbXQzGjM=;4h$yT3?~1Xf$~7tF>`SMUCzu1m1NL>>Jb%UV8Qeck2X*(0~=5=P}14QF*uk(7^ql)0TNU"
        "$p1!Vr!Jhtp@xjiHKCTQrG9cxw5aoW3zOG=^Oi*0GAOO_Z&H}Np0_G!gvZJoi?!a{Puz;G*z(PV;XmFqgKOMrN5*!x%)C&ur_S?4buuuV7!h{G5R"
        "<tl7E}gJz08L^5r(A~X%n%(MXtpkZ(vWb3h13H4;TQu77=B>Di6DoXk7sZQgCsOS#i4eAVicA+U^K{09vlcZG9RMmj%~pQ4_C(k5L*IC7YKZ3M)g"
        "5)YI0F(iC$7>9)$1j?BUIm1971N$b~_!ZmvPDe$K8C7ltuGT$qwrl31Ktf^cd|W^QU;F)%kXa0tM|S^?|>Ml?6T^E(v0*)}_qp7z4{Dtt?>k5&Mq"
        "V8nxl7CA={y#h*KfYLvpv_dOXTqqbsH(Y|y3|FE2>p<Gw+2048u>?>v8LY^JRsKw9;+xUja)5s{K1RVP7zLwX6pVsVFbYP&C>RB!U=)mk!3qGwc*"
        "L{"
    ),
    "a virtual dataset": (
        "c-rgqaB<`1lHy|K;9!7(|4`r|0pS}!#U-qI-}!sE1TisGFbN?mgaIxl21W)3HXa5b#aOW!stwAo+|LN*i-7o?sX3`-i6xo&d8e763KbX#0ulK)T3"
        "{yt4P*qG!^FtQ$O@H%(aa(YjDiaG3=j`FFqm*NnEYo3$^%`;%*6q8IWr?vl0gHiM^uP`1=Bw~+Ca4oY(T|8NoOC&;9v$}pke_a2D#bA)7RB6*wf!"
        "HKG@mO$CZIc2Be%7qTJ8X*A=Xq35qKi1b`ajSs)fxz<gxRKrVQ3EY1f#ETE<{u#gZI8XTy>PlvFm1c$|QW~zn7zrS2M;IL3kC}PP*#=x*q0b0t02"
        "pd+kFd{15aC7hhbufEC!-^4iIK_ZG&JPS25#&(u@eB@Okc0-9I1qyj0>v0C@xy44$uL`((fD8&>ya8ZhiCpY@pty{=E;G$%mC!FAXhinAXh(USBT"
        "5Pm>@1oNi0b$PAx$=F(orMHLn<$OBpx>;9;f!b~z)Gi$MUMkD=hrw%M8Vv=_!#;ahT@VHAvlQ9vAMXpwUS(JP?z1t|RkN-MNN#f5@Fbi*YG&2SaU"
        "zYe6`o&9~l8BhQ<Gx{)~<<|W2JiWYR26*icFXR}I3PP|L6BAS;BRKnmXjX=g$6x-36^#tgvH}EPjSChu@y%#{P2eAm?@=%cM!_f;1*2dTjDk@x3P"
        "!;w7zLw%TmS$U*2Q@"
    ),
    "an external link": (
        "c-rgqaB<`1lHy_j0S*oZ76t(ZWbhvfJUCGKF!=;1%?PDCp!5nRm^d3)P68?}05!jZ4Z@!Q6%Pq=bp@&Zj|O1&7_h+fkAjg1JX{?EKy(C@4@*xcm{"
        "8SKK<P@fbm>5*y^IX(5HlEIe2C4Aj1U1<s5%(U43r1S2rAe!a6oM~;bt)T&kR$?0hVWCVgeh$0X2`A5vrU)1I2zG1_O9L;s8QtAIIQeAYT}o7hwK"
        "#@$_}|3-<K)iw|~o^l=61(}3z@1?%&3^mS!`>SIFER{^(4fvE5Z_VagP1e(AB)5VNmJuJUgu#To-QqmQ)xP#N=rz;H(Z1GF$bX7@Wx?+OoXzVor7"
        "u0_+zy?iOj0}tw$Y~Hsyb?LhvBBKU;lP=ilUkNol9`_ebaZ}so?c!ugFakr1g6D?7CA?7oeiZgK<OV)TA>vxE))!+8!ka;hO1Eibs!A@Fhy;8"
    ),
    "an external link, among many": (
        "c-rgqaB<`1lHy|K;9!7(|4`t;1>qY&#a~>AZSePS31VWXU=jieOk;*fXs|$NE+z&>AQiztGf-%9r624BMg~Sk5e5b(Mn*<fs2q%D7GYo%RIq1&c*"
        "udlgqy+SKhUMDK-V#IaR6P;%m|fa(17X@6=GmPcpL_Jw1H|F*no<GlFmMk!NCl|K*a(;%ml<Pp1!Vr!Jhtp@xjiHKCTQrG9cxw5aoW3zOG=^Oi*0"
        "Gz~D{Qu(%VUxDY)opb^2qLPA(*K*K_Teqm8b?XZ~W<5K4q9PG;A2lYAQ3<ib_P+~0ZEtOyxYQQbXBY=S&99RMj82NGrln?VOI7pFcDBvd2HWnnEj"
        "L@XO$lw7l5H{Ht|8@%TZ~;aq6U5XMjRh<)J7Bgf{hS=&77SFyFayOb1dXsS0GJyT;4-J7wo5Uf(r49LRyu|FxG}KS)uysDC<29e7<4CJ3S>|MYE)"
        ");H~DNO!!!mE(<6kvkzps8**b-zn?V=MJj5*3&u|CK?A`Nm9fK=a+c&03I~e{$6f_&1Whe$S+r0SC0o?^+E^l4)i$N4@8;ec+Nrq7{3WhUiXpwUS"
        "(JP?z1t|RkN-MNN#f5@Fbi*YG&2SaUzYe6`JY1aM?Ew(jbDpaTSTR*>h8F^imHVM30V9V4S87gbSz<|Mex3oaV#qJg)5}X{(1#16DlsIi#E7sGW5"
        "P;I2rDrqti+745_7^zEU+pWtN;Ld-~F}"
    ),
}
